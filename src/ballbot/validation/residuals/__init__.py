"""What the residuals of the one-step prediction tell: what goes together, what is not white, what the wheels do."""

from ballbot.validation.residuals.analysis import ResidualAnalysis, analyse_residuals
from ballbot.validation.residuals.updates import Updates, find_updates

__all__ = ["ResidualAnalysis", "Updates", "analyse_residuals", "find_updates"]

"""Identification of friction and other parameters from logs, with standard errors and validation."""

from ballbot.identification.holdout import HoldoutResult, cross_validate
from ballbot.identification.identify import identify
from ballbot.identification.laws import select_law
from ballbot.identification.parameters import Bounds, read_bounds
from ballbot.identification.result import Identification, WindowErrors
from ballbot.progress import Progress

__all__ = [
    "Bounds",
    "HoldoutResult",
    "Identification",
    "Progress",
    "WindowErrors",
    "cross_validate",
    "identify",
    "read_bounds",
    "select_law",
]

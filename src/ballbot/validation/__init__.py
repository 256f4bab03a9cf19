"""Validation: a robot's model against its logs, in closed loop, in open loop and by one-step prediction."""

from ballbot.validation.feedback import RecoveredGain, recover_gain
from ballbot.validation.findings import findings
from ballbot.validation.state_errors import ErrorPair, StateErrors
from ballbot.validation.validation import Validation, join_validations, validate

__all__ = [
    "ErrorPair",
    "RecoveredGain",
    "StateErrors",
    "Validation",
    "findings",
    "join_validations",
    "recover_gain",
    "validate",
]

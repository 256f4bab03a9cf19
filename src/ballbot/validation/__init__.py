"""Validation: a robot's model against its logs, in closed loop, in open loop and by one-step prediction."""

from ballbot.validation.closed_loop import RecoveredGain, recover_gain
from ballbot.validation.models import ErrorPair, ModelPair, NamedModel
from ballbot.validation.result import Validation, findings
from ballbot.validation.validation import join_validations, validate, validate_logs, validate_pair

__all__ = [
    "ErrorPair",
    "ModelPair",
    "NamedModel",
    "RecoveredGain",
    "Validation",
    "findings",
    "join_validations",
    "recover_gain",
    "validate",
    "validate_logs",
    "validate_pair",
]

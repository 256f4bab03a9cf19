"""Identify friction and other parameters from logs, with standard errors and validation."""

from ballbot.identification.holdout import HoldoutResult, cross_validate
from ballbot.identification.identify import IdentificationOptions, identify
from ballbot.identification.prediction import WindowErrors
from ballbot.identification.quantities import Bounds, read_bounds
from ballbot.identification.result import Identification
from ballbot.progress import Progress

__all__ = [
    "Bounds",
    "HoldoutResult",
    "Identification",
    "IdentificationOptions",
    "Progress",
    "WindowErrors",
    "cross_validate",
    "identify",
    "read_bounds",
]

"""Sensors against motion capture: clock, frame, lever arm and flips, then errors and drifts (thesis, Appendix IV)."""

from ballbot.validation.alignment.align import Alignment, align
from ballbot.validation.alignment.clock import Clock
from ballbot.validation.alignment.errors import PositionError, SensorError, SensorErrors
from ballbot.validation.alignment.flips import Flip
from ballbot.validation.alignment.frame import Frame
from ballbot.validation.alignment.lever import Lever
from ballbot.validation.alignment.motion_fit import MotionFit
from ballbot.validation.alignment.words import alignment_findings

__all__ = [
    "Alignment",
    "Clock",
    "Flip",
    "Frame",
    "Lever",
    "MotionFit",
    "PositionError",
    "SensorError",
    "SensorErrors",
    "align",
    "alignment_findings",
]

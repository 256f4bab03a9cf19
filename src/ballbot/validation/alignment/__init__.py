"""Sensors against motion capture: clock, frame, lever arm and flips, then errors and drifts (thesis, Appendix IV)."""

from ballbot.validation.alignment.align import Alignment, PositionError, SensorError, SensorErrors, align
from ballbot.validation.alignment.clock import Clock
from ballbot.validation.alignment.findings import alignment_findings
from ballbot.validation.alignment.frame import Frame, Lever
from ballbot.validation.alignment.motion import Flip, MotionFit

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

"""Sensors against motion capture: clock, frame and lever arm, then errors and drifts (thesis, Appendix IV)."""

from ballbot.identification.turning import Clock, MotionFit
from ballbot.validation.alignment.align import Alignment, SensorErrors, align
from ballbot.validation.alignment.findings import alignment_findings

__all__ = ["Alignment", "Clock", "MotionFit", "SensorErrors", "align", "alignment_findings"]

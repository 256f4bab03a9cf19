"""Sensors against motion capture: clock, frame and lever arm, then errors and drifts (thesis, Appendix IV)."""

from ballbot.validation.alignment.align import Alignment, SensorErrors, align
from ballbot.validation.alignment.findings import alignment_findings
from ballbot.validation.alignment.turning import Clock, MotionFit

__all__ = ["Alignment", "Clock", "MotionFit", "SensorErrors", "align", "alignment_findings"]

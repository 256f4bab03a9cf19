"""Friction from logs: what a robot's own motion tells, how surely, and what it does not."""

from ballbot.identification.bounds import Bounds, read_bounds
from ballbot.identification.identify import identify
from ballbot.identification.judging import Judged, judge
from ballbot.identification.ladder import Ladder, climb
from ballbot.identification.progress import Progress
from ballbot.identification.result import Identification, WindowErrors

__all__ = [
    "Bounds",
    "Identification",
    "Judged",
    "Ladder",
    "Progress",
    "WindowErrors",
    "climb",
    "identify",
    "judge",
    "read_bounds",
]

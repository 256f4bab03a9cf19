"""Experiments that tell the most: references designed within limits so that the worst standard error is small."""

from ballbot.experiments.excite.design import Design, Effort, design
from ballbot.experiments.excite.deviations import deviations_found
from ballbot.experiments.excite.excite import Excitation, excite
from ballbot.experiments.excite.limits import Limits, Peaks
from ballbot.experiments.excite.task import Law, Task, task
from ballbot.experiments.excite.trial import Trial

__all__ = [
    "Design",
    "Effort",
    "Excitation",
    "Law",
    "Limits",
    "Peaks",
    "Task",
    "Trial",
    "design",
    "deviations_found",
    "excite",
    "task",
]

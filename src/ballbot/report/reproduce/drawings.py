"""Every drawing by the name of its figure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from matplotlib.figure import Figure

from ballbot.experiments.reproduce.bench import Bench
from ballbot.report.reproduce import (
    appendix1,
    appendix3,
    appendix4,
    appendix5,
    chapter2,
    chapter3,
    chapter4,
    chapter5,
)

Drawing = Callable[[Bench], Figure]

_CHAPTERS = (chapter2, chapter3, chapter4, chapter5, appendix1, appendix3, appendix4, appendix5)

#: by `Item.key`, in the thesis's order; tables have none
DRAWINGS: Mapping[str, Drawing] = MappingProxyType(
    {
        name: draw
        for chapter in _CHAPTERS
        for name, draw in vars(chapter).items()
        if name.startswith("figure_")
    }
)

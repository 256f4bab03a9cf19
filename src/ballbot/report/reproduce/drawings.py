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

#: by `Item.key`; tables have none
DRAWINGS: Mapping[str, Drawing] = MappingProxyType(
    {
        draw.__name__: draw
        for draw in (
            chapter2.figure_2_1,
            chapter3.figure_3_1,
            chapter3.figure_3_2,
            chapter3.figure_3_4,
            chapter3.figure_3_5,
            chapter4.figure_4_1,
            chapter4.figure_4_2,
            chapter4.figure_4_3,
            chapter5.figure_5_1,
            chapter5.figure_5_2,
            chapter5.figure_5_3,
            chapter5.figure_5_4,
            chapter5.figure_5_5,
            chapter5.figure_5_6,
            chapter5.figure_5_7,
            chapter5.figure_5_8,
            appendix1.figure_i_1,
            appendix3.figure_iii_1,
            appendix4.figure_iv_1,
            appendix4.figure_iv_2,
            appendix4.figure_iv_3,
            appendix4.figure_iv_4,
            appendix5.figure_v_1,
            appendix5.figure_v_2,
        )
    }
)

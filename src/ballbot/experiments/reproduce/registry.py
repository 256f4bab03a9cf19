"""Every figure and table of the thesis that is remade, in its order."""

from __future__ import annotations

from collections.abc import Callable

from ballbot.experiments.reproduce import (
    appendix1,
    appendix3,
    appendix4,
    appendix5,
    chapter2,
    chapter3,
    chapter4,
    chapter5,
)
from ballbot.experiments.reproduce.bench import Bench
from ballbot.experiments.reproduce.item import Item

ITEMS: tuple[Callable[[Bench], Item], ...] = (
    chapter2.figure_2_1,
    chapter3.figure_3_1,
    chapter3.figure_3_2,
    chapter3.figure_3_4,
    chapter3.figure_3_5,
    chapter4.figure_4_1,
    chapter4.table_4_1,
    chapter4.figure_4_2,
    chapter4.table_4_2,
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

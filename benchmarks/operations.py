"""How many operations one step takes, counted in the compiled code, and how many this machine can do."""

from __future__ import annotations

import re
from collections import Counter
from time import perf_counter

import numpy as np
from numba import njit

from ballbot.mechanics.engine.compiled import FAST
from ballbot.mechanics.engine.lanes import LANES, ROWS, STEP, TRIAL, stored
from ballbot.mechanics.engine.loading import load
from ballbot.mechanics.engine.run import load_state, load_torques
from ballbot.mechanics.engine.smooth import runge_kutta_step
from ballbot.mechanics.model import Model

_COUNTED = ("fadd", "fsub", "fmul", "fdiv", "fneg", "fcmp", "select", "sqrt", "fptosi", "sitofp")


def operations_of_a_step(model: Model) -> Counter[str]:
    """Return the floating-point operations of one RK4 step with its checks, from LLVM's optimised code of one lane."""

    def one_lane(selected, work):
        P, state, u = load(selected, work, 0), load_state(selected, work, 0), load_torques(selected, work, 0)
        end, margin = runge_kutta_step(selected, P, state, u, work[STEP * LANES])
        stored(work, TRIAL, 0, end)
        return margin

    function = njit(error_model="numpy", fastmath=FAST)(one_lane)
    function(model.selected, np.ones(ROWS * LANES))
    (code,) = function.inspect_llvm().values()
    body = code[: code.index("\n}")] if "\n}" in code else code
    return Counter(
        {name: len(re.findall(rf"= (?:tail )?(?:call .*@llvm\.)?{name}\b", body)) for name in _COUNTED}
    )


def peak_rate() -> float:
    """Return multiply-adds a second of one core, measured on 64 independent chains."""

    @njit(fastmath=True)
    def chains(x, a, b, repeats):
        for _ in range(repeats):
            for i in range(64):
                x[i] = x[i] * a + b

    x, repeats = np.ones(64), 2_000_000
    chains(x, 0.999, 0.001, 10)
    best = float("inf")
    for _ in range(3):
        started = perf_counter()
        chains(x, 0.999, 0.001, repeats)
        best = min(best, perf_counter() - started)
    return 64 * repeats / best

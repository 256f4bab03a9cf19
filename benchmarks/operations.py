"""How many operations one step takes, counted in the compiled code, and how many this machine can do."""

import re
from collections import Counter
from time import perf_counter

import numpy as np
from numba import njit

from ballbot.mechanics.engine.compiled import FAST
from ballbot.mechanics.engine.lanes import LANES, ROWS, STEP, TRIAL, load, stored
from ballbot.mechanics.engine.run import load_state, load_torques
from ballbot.mechanics.engine.smooth import (
    acceleration,
    ball_velocity,
    body_velocity,
    in_state_order,
    moving_margin,
    net_torques,
    pose,
    smallest_margin,
)
from ballbot.mechanics.engine.tracing import traced
from ballbot.mechanics.engine.vector import add, advanced, each, smallest
from ballbot.mechanics.equations import rates_of_angles
from ballbot.mechanics.floor import floor_friction, floor_margin
from ballbot.mechanics.friction import directed_friction, sign
from ballbot.mechanics.model import Model

_COUNTED = ("fadd", "fsub", "fmul", "fdiv", "fneg", "fcmp", "select", "sqrt", "fptosi", "sitofp")


@traced
def rate_of_change(selected, P, a, state, torques):
    """Return the state's rate of change under the wheels' net torques."""
    v, w = ball_velocity(state), body_velocity(state)
    v_dot, w_dot = acceleration(selected, P, a, v, w, torques, floor_friction(P, v))
    return in_state_order((v[0], v[1]), rates_of_angles(selected, a, w), v_dot, w_dot)


@traced
def derivative(selected, P, state, u, signs):
    """Return the state's rate of change, and the wheel speeds."""
    a, speeds = pose(selected, P, state)
    dry = each(directed_friction, P.wheels, speeds, signs)
    return rate_of_change(selected, P, a, state, net_torques(P, u, speeds, signs, dry)), speeds


@traced
def runge_kutta_step(selected, P, state, u, h):
    """Take one RK4 step with the friction's signs of its start, in one piece.

    A block of lanes takes the same step in parts (`smooth_block`).

    Returns
    -------
    state : tuple of 10 or 11
    margin : float
        Positive where no friction changed its sign within the step, so that the step counts.
    """
    signs = each(sign, pose(selected, P, state)[1])
    k1, speeds1 = derivative(selected, P, state, u, signs)
    second = advanced(state, k1, 0.5 * h)
    k2, speeds2 = derivative(selected, P, second, u, signs)
    third = advanced(state, k2, 0.5 * h)
    k3, speeds3 = derivative(selected, P, third, u, signs)
    fourth = advanced(state, k3, h)
    k4, speeds4 = derivative(selected, P, fourth, u, signs)
    end = advanced(advanced(state, add(k1, k4), h / 6.0), add(k2, k3), h / 3.0)

    wheels = [smallest_margin(P, signs, speeds) for speeds in (speeds1, speeds2, speeds3, speeds4)]
    floor = [floor_margin(P, state, at) for at in (state, second, third, fourth, end)]
    margins = (*wheels, *floor, moving_margin(P, ball_velocity(state), speeds1, h))
    return end, smallest(margins)


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

"""Errors with identified friction over those without, state by state, beside the ratios of the thesis's tables.

The logs are the test robot's (`campaigns.section.data_folder`): two are fitted, three quarters of their windows, and
two are not. The thesis's ratios are those of Tables 4.1 (closed loop) and 4.2 (open loop).
"""

from __future__ import annotations

from functools import cache
from time import perf_counter

import numpy as np

from ballbot.identification import Identification, cross_validate, identify
from ballbot.log import STATE_NAMES, Log
from ballbot.robot import Robot
from ballbot.validation import validate
from campaigns.section import Section, data_folder

#: error with friction and without, as printed
TABLE_4_1 = {
    "x": (0.0037, 0.0154),
    "y": (0.0027, 0.0103),
    "theta": (0.0002, 0.0003),
    "phi": (0.0002, 0.0004),
    "psi": (0.0051, 0.0067),
    "x_dot": (0.0013, 0.0035),
    "y_dot": (0.0012, 0.0021),
    "theta_dot": (0.0022, 0.0023),
    "phi_dot": (0.0016, 0.0017),
    "psi_dot": (0.0053, 0.0060),
}
TABLE_4_2 = {
    "x": (0.0012, 0.0062),
    "y": (0.0012, 0.0030),
    "theta": (0.0005, 0.0054),
    "phi": (0.0004, 0.0106),
    "psi": (0.0049, 0.0207),
    "x_dot": (0.0044, 0.0324),
    "y_dot": (0.0051, 0.0195),
    "theta_dot": (0.0055, 0.0320),
    "phi_dot": (0.0072, 0.0573),
    "psi_dot": (0.0182, 0.0939),
}
FITTED = ("square_soft", "hold_soft")
OTHERS = ("thesis_step_soft", "square_stiff")


def log_of(name: str) -> Log:
    """Return a log of the test robot."""
    return Log.read(data_folder() / "bbr" / f"{name}.csv")


@cache
def identified() -> tuple[Identification, float]:
    """Return what the two soft logs tell, and the seconds it took."""
    started = perf_counter()
    found = identify(Robot.load("alten"), [log_of(name) for name in FITTED], seed=0)
    return found, perf_counter() - started


def campaign() -> Section:
    """Identify, judge and return the section of docs/generated/evidence.md."""
    found, seconds = identified()
    judged = [cross_validate(found, log_of(name), name=name) for name in OTHERS]
    validation = validate(found.robot, log_of("thesis_step_soft"))
    assert validation.closed_loop is not None
    closed, opened = 1.0 / validation.closed_loop.restarted.ratio, 1.0 / validation.open_loop.errors.ratio
    rows = []
    for place, state in enumerate(STATE_NAMES):
        thesis = [with_it / without for with_it, without in (TABLE_4_1[state], TABLE_4_2[state])]
        windows = [found.held_out.ratios[state], *(one.errors.ratios[state] for one in judged)]
        ratios = [thesis[0], float(closed[place]), thesis[1], float(opened[place]), *windows]
        rows.append([state.replace("_", r"\_"), *(f"{ratio:.2f}" for ratio in ratios)])
    below = [int(np.sum([ratio < 1.0 for ratio in one.errors.ratios.values()])) for one in judged]
    return Section(
        title="Errors with identified friction over those without",
        before="The test robot is a physics engine's: omni-wheel rollers in two rows, slip, gear play, friction of "
        "each wheel, sensor noise and heading drift, its friction unknown; its logs are not shipped. "
        "Twelve parameters from `square_soft` and `hold_soft` together, three quarters of their windows of 0.25"
        f" s, in {seconds:.0f} s with bootstrap and profiles. Closed loop restarted every 4 s and open loop to a fall"
        " or 2 s are of `thesis_step_soft`, which was not fitted; windows are open loop, 0.25 s.",
        columns=[
            "state",
            "thesis, closed loop (4.1)",
            "closed loop",
            "thesis, open loop (4.2)",
            "open loop",
            "windows held out",
            *(f"windows, {name}" for name in OTHERS),
        ],
        rows=rows,
        after=f"Below one in {below[0]} of 10 states on `{OTHERS[0]}` and in {below[1]} on `{OTHERS[1]}`. "
        + " ".join(remark.text for one in judged for remark in one.remarks[-1:]),
    )

"""Identify friction from the twin's logs by all stages, and validate it on other logs.

.venv/bin/python -m campaigns.evidence identified_errors identified_friction drivelines validation

The logs are recorded on the nominal twin with its own sensors, balanced by a gain without compensation.
`ballbot record nominal --reference square --duration 32 --seed 1 --out square` makes the first of them. The ratios for
comparison are those of the thesis's Tables 4.1 (closed loop) and 4.2 (open loop).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from time import perf_counter

import numpy as np

from ballbot import Controller, simulate
from ballbot.control.presets import (
    PRECISE_STATE_WEIGHTS,
    PRECISE_TORQUE_WEIGHT,
    design_gain,
    nominal_controller,
)
from ballbot.control.references import named_reference
from ballbot.findings import texts
from ballbot.identification import Identification, cross_validate, identify
from ballbot.identification.driveline import fit_driveline, robot_with_friction, sweep_estimate, sweeps_of
from ballbot.identification.upside_down import identify_upside_down
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.friction import wheel_friction
from ballbot.report.driveline import parameter_rows
from ballbot.robot import Robot
from ballbot.rounding import digits
from ballbot.twin import Scenario, Twin
from ballbot.twin.bench import Bench, multisine_torques, run_bench, sweep_torques
from ballbot.validation import ErrorPair, Validation, findings, validate
from campaigns.section import Section

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
ROBOT = Robot.load("alten")
NOMINAL = Scenario.nominal(ROBOT)
SOFT = nominal_controller(ROBOT)
#: the precise controller's weights on the thesis's on-board state: the motors chatter in the gears' play
STIFF = Controller(
    ROBOT,
    design_gain(ROBOT, state_weights=PRECISE_STATE_WEIGHTS, torque_weight=PRECISE_TORQUE_WEIGHT).gain,
)
#: the logs of balancing: reference, seed and controller
BALANCING = {
    "square": ("square", 1, SOFT),
    "hold": ("hold", 2, SOFT),
    "change_pose": ("change_pose", 3, SOFT),
    "figure_eight": ("figure_eight", 4, SOFT),
    "square_stiff": ("square", 5, STIFF),
}
DURATION = 32.0  #: of each log [s]
FITTED = ("square", "hold")
OTHERS = ("change_pose", "square_stiff")
NOT_FITTED = ("figure_eight", "change_pose")


@cache
def log_of(name: str) -> Log:
    """Return a log of balancing as the twin's own sensors have it, without the truth."""
    reference, seed, controller = BALANCING[name]
    log = simulate(Twin(ROBOT), controller, named_reference(reference), duration=DURATION, seed=seed)
    return log.without_truth()


@cache
def bench_log(bench: Bench) -> Log:
    """Return a minute of the held twin: the thesis's sweep on the stand, sines with the ball on the wheels."""
    if bench == "stand":
        torques = sweep_torques(ROBOT, NOMINAL, duration=62.83)
    else:
        torques = multisine_torques(ROBOT, NOMINAL, duration=60.0, seed=5)
    return run_bench(ROBOT, NOMINAL, torques, bench=bench, seed=5).log


@cache
def identified() -> tuple[Identification, float]:
    """Return the identification from the two fitted logs, and the seconds it took."""
    started = perf_counter()
    found = identify(ROBOT, [log_of(name) for name in FITTED], seed=0)
    return found, perf_counter() - started


def identified_errors() -> Section:
    """Identify, predict the other logs and return the section of docs/generated/evidence.md."""
    found, seconds = identified()
    judged = [cross_validate(found, log_of(name), name=name) for name in OTHERS]
    validation = validate(found.robot, log_of("change_pose"))
    assert validation.closed_loop is not None
    assert validation.open_loop is not None
    closed, opened = 1.0 / validation.closed_loop.restarted.ratio, 1.0 / validation.open_loop.errors.ratio
    rows = []
    for place, state in enumerate(STATE_NAMES):
        thesis = [with_it / without for with_it, without in (TABLE_4_1[state], TABLE_4_2[state])]
        windows = [
            found.held_out.with_over_without[state],
            *(one.errors.with_over_without[state] for one in judged),
        ]
        ratios = [thesis[0], float(closed[place]), thesis[1], float(opened[place]), *windows]
        rows.append([state.replace("_", r"\_"), *(f"{ratio:.2f}" for ratio in ratios)])
    below = [int(np.sum([ratio < 1.0 for ratio in one.errors.with_over_without.values()])) for one in judged]
    return Section(
        title="Errors with identified friction over those without",
        before=f"Logs of {DURATION:g} s recorded on the nominal twin with its own sensors: rollers in two rows, slip, "
        "gear play, friction of each wheel, sensor noise and heading drift. Twelve parameters are identified from "
        "`square` and `hold` together, from three quarters of their windows of 0.25 s, in "
        f"{seconds:.0f} s with bootstrap and profiles. `change_pose` and `square_stiff` (a stiff gain) are not fitted. "
        "Closed loop restarted every 4 s and open loop to a fall or 2 s are of `change_pose`; windows are open loop, "
        "0.25 s.",
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
        + " ".join(finding.text for one in judged for finding in one.findings[-1:]),
    )


SPEEDS = (0.2, 0.5, 1.0, 2.0, 5.0)  # [rad/s]


def identified_friction() -> Section:
    """Identify by all three stages and return the section of docs/generated/evidence.md."""
    fits = [fit_driveline(sweep) for sweep in sweeps_of(ROBOT, bench_log("stand"))]
    upside_down = identify_upside_down(ROBOT, bench_log("upside_down")).robot.friction
    stages = {
        "driveline, wheel free": robot_with_friction(ROBOT, sweep_estimate(fits), source="stand").friction,
        "upside down, ball on the wheels": replace(upside_down, rolling=0.0),
        "balancing": identified()[0].robot.friction,
        "set in the twin's drivelines": NOMINAL.friction,
    }
    rows = []
    for name, friction in stages.items():
        torque = wheel_friction(np.repeat(np.array(SPEEDS)[:, None], 3, axis=1), friction).mean(axis=1)
        parts = [np.mean(values) for values in (friction.viscous, friction.coulomb, friction.stribeck)]
        shared = [friction.stribeck_speed, friction.stribeck_exponent]
        rows.append([name, *(f"{value:.3f}" for value in [*parts, *shared, *torque])])
    return Section(
        title="Friction by the three stages",
        before="The nominal twin's friction from a sweep with the wheels free, from a minute upside down and from two "
        "logs of balancing, beside the friction that its drivelines are given. Means over the wheels; the last columns "
        "are the friction torque [N m] at that wheel speed [rad/s].",
        columns=["stage", "b", "c", "s", "v_s", "delta", *(f"at {speed:g}" for speed in SPEEDS)],
        rows=rows,
        after="The sweep shows the friction of motor and gear. When the robot balances, the wheels also carry its "
        "weight on the ball. Slip and losses between rollers, ball and floor grow with speed, and a model that rolls "
        "without slip can express them by b only. Predict and compensate with the friction identified from balancing; "
        "assess motors and gears by the sweep's.",
    )


def drivelines() -> Section:
    """Fit every wheel and return the section of docs/generated/evidence.md."""
    sweeps = sweeps_of(ROBOT, bench_log("stand"))
    fits = [fit_driveline(sweep) for sweep in sweeps]
    rows = [[f"{name} [{unit}]" if unit else name, *cells] for name, unit, *cells in parameter_rows(fits)]
    rows.append(["RMS speed error [rad/s]", *(f"{fit.rmse:.3f}" for fit in fits)])
    rows.append(["without friction", *(f"{fit.rmse_without:.1f}" for fit in fits)])
    return Section(
        title="Stage one: the drivelines, wheels free",
        before="The thesis's sweep on the nominal twin, wheels free: a sine of 1 N m and 62.83 s. Each "
        "wheel is fitted as an axis of known inertia, with delta = 1; in brackets 95 % intervals.",
        columns=["", *(f"wheel {fit.wheel}" for fit in fits)],
        rows=rows,
        after=" ".join(texts([one for fit in fits for one in fit.findings])),
    )


def validation() -> Section:
    """Validate on the logs that were not fitted and return the section of docs/generated/evidence.md."""
    robot = identified()[0].robot
    validations = {name: validate(robot, log_of(name)) for name in NOT_FITTED}
    closed = validations[NOT_FITTED[0]].closed_loop
    assert closed is not None
    pairs = [closed.restarted, *(_open_loop(one) for one in validations.values())]
    rows = []
    for place, state in enumerate(STATE_NAMES):
        with_friction, without = TABLE_4_1[state]
        cells = [f"{without / with_friction:.1f}", *(_cell(pair, place) for pair in pairs)]
        rows.append([state.replace("_", r"\_"), *cells])
    return Section(
        title="Friction validated on other logs",
        before="Error (4.1) of the model without friction over that of the model with it, and its 95 % interval from a "
        f"bootstrap of blocks of runs, on logs of {DURATION:g} s of the nominal twin that the friction was not "
        "identified from (see [errors with identified friction](#errors-with-identified-friction-over-those-without)). "
        "Closed loop restarted every 4 s, open loop to a fall or 2 s, a start every second.",
        columns=[
            "state",
            "Table 4.1, closed loop",
            f"closed loop, `{NOT_FITTED[0]}`, {closed.restarted.runs} runs",
            *(f"open loop, `{name}`, {_open_loop(one).runs}" for name, one in validations.items()),
        ],
        rows=rows,
        after=_after(validations, closed.restarted),
    )


def _open_loop(validation: Validation) -> ErrorPair:
    assert validation.open_loop is not None
    return validation.open_loop.errors


def _cell(pair: ErrorPair, place: int) -> str:
    lower, upper = pair.ratio_interval()[:, place]
    ratio = digits(pair.ratio[place])
    return f"{ratio} ({digits(lower)} to {digits(upper)})" if lower == lower else f"{ratio} (too few runs)"


def _after(validations: dict[str, Validation], closed: ErrorPair) -> str:
    """Return in how many states each interval lies above one, and the findings about the first log's residuals."""
    first = NOT_FITTED[0]
    counts = [f"in closed loop on `{first}` in {closed.verdicts().count('better')} of ten states"]
    for name, one in validations.items():
        pair = _open_loop(one)
        if np.isfinite(pair.ratio_interval()[0, 0]):
            counts.append(f"in open loop on `{name}` in {pair.verdicts().count('better')}")
    texts = "\n".join(f"- {one.text}" for one in findings(validations[first])).replace("_", r"\_")
    report = f"`ballbot validate` reports for `{first}`:\n\n{texts}"
    return f"The whole interval is above one {', '.join(counts)}.\n\n{report}"

"""The figures and tables of the thesis: what each shows, what ours shows, the numbers that decide, and the drawing.

Figure III.1 is made on simulated swings, those of Appendix IV on three-minute runs of the twin. All runs of chapter 5
are the thesis's change of reference, from [0 0 0] to [1 -1 pi] at t = 3 s in a step, under the nominal gain; the thesis
prints no gain. What is compensated is the friction identified from the twin's logs, with the controller's ramp where
the thesis has a sign: in a simulation that really sticks, a bare sign compensates nothing at rest, and the robot stays
where it stopped. The words give both. Models with friction are run from several starts, the twin with several seeds,
and the verdict is on the median with its interval; after arrival means from `ARRIVED` on, when the approach itself is
over. The drawings are the toolkit's own.
"""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from ballbot.arrays import Floats
from ballbot.identification.driveline import DrivelineFit, Sweep, fit_driveline
from ballbot.identification.swing import inertia_of_swing
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.friction import steady_friction
from ballbot.mechanics.parameters import Formulation
from ballbot.report.alignment import errors_series
from ballbot.report.bench import measured_figure, swing_series
from ballbot.report.blocks import Sheet
from ballbot.report.comparison import candidate_name, paths_figure, position_error_series
from ballbot.report.series import Line, Look, Panel, TimeSeries, together
from ballbot.report.style import LOOKS, STATE_UNITS, one_panel, thinned
from ballbot.report.validation import correlation_figure, symbols
from ballbot.report.words import state_mark
from ballbot.thesis.reproduce.bench import BASIC, FIRST_LEAN, STEPS, Bench
from ballbot.thesis.reproduce.item import RUNS, ClaimCheck, Item, check, over_runs
from ballbot.thesis.reproduce.mistakes import clear_correlation, largest_lean, velocity_pairs
from ballbot.thesis.reproduce.recordings import ARRIVED
from ballbot.thesis.reproduce.runs import (
    AHEAD,
    MODELS,
    RESTART,
    Validated,
    above,
    apart,
    distance_at,
    largest_apart,
    peak_after_arrival,
    steady_error,
    way_apart,
)
from ballbot.validation.alignment import Alignment, SensorErrors
from ballbot.validation.statistics import Correlations
from ballbot.workflows.metrics import position_error, rms
from ballbot.workflows.statistics import median_with_interval

# --- chapter 3, friction ----------------------------------------------------------------------------

#: the supply's speed limit that the thesis reads from its sweep [rad/s]
THESIS_LIMIT = 27.7
#: speed at which the wheels are held beside each other [rad/s], and how wide a sample of rows is taken there
_SPEED, _NEAR = 10.0, 0.5
#: part of the largest of three values by which they may differ and be "roughly the same"
_ROUGHLY = 0.2


def figure_3_1(bench: Bench) -> Item:
    """Torque and speed of the free wheels under a slow sine of torque."""
    fastest = max(float(np.abs(sweep.speed).max()) for sweep in bench.sweeps)
    torques = [_torque_at(sweep, _SPEED) for sweep in bench.sweeps]
    spread = (max(torques) - min(torques)) / max(torques)
    low, high = 0.99 * THESIS_LIMIT, 1.01 * THESIS_LIMIT
    alike = f"spread of their torques at {_SPEED:g} rad/s, of the largest"
    return Item(
        title="Torque and speed of the wheels, without the ball, under 1 N m at a period of 62.83 s",
        thesis="All three wheels have roughly the same characteristic, with a speed limit at 27.7 rad/s.",
        ours=f"The twin's wheels reach {fastest:.2f} rad/s; at {_SPEED:g} rad/s they take "
        f"{', '.join(f'{torque:.3f}' for torque in torques)} N m.",
        checks=(
            check(
                "the speed limit is at 27.7 rad/s", "greatest speed of a wheel", fastest, "rad/s", low, high
            ),
            check("all wheels are roughly the same", alike, spread, highest=_ROUGHLY),
        ),
        figure=lambda: measured_figure(bench.sweeps),
    )


def figure_3_2(bench: Bench) -> Item:
    """One wheel's sweep beside the models with and without friction."""
    sweep = bench.sweeps[0]
    fit = fit_driveline(sweep)
    b, c = fit.values[:2]
    speed = np.abs(sweep.speed[sweep.speed != 0.0])
    share = float(np.sum(b * speed + c) / np.sum(steady_friction(speed, fit.friction)))
    ratio = fit.rmse_without / fit.rmse
    return Item(
        title="One wheel's sweep: measured, with and without friction in the model",
        thesis="The model with friction is closer to the measurement than the one without; most of the "
        "friction is viscous and Coulomb.",
        ours=f"Over the sweep the speed errs by {fit.rmse:.2f} rad/s with the friction found (where the "
        f"supply does not limit it) and by {fit.rmse_without:.2f} rad/s without, whose clamp (3.2) winds up "
        "and holds the wheel at the limit while the torque brakes (mistake 9); viscous and Coulomb friction "
        f"are {100.0 * share:.0f} % of it, summed over the sweep.",
        checks=(
            check(
                "the model with friction is closer",
                "RMS error without friction over that with",
                ratio,
                lowest=1.0,
            ),
            check("most of the friction is viscous and Coulomb", "their share", share, lowest=0.5),
        ),
        figure=lambda: torque_speed_figure(sweep, fit),
    )


def figure_3_4(bench: Bench) -> Item:
    """The ball on the clamped wheels under its own LQR."""
    movement, friction = bench.ball_movement, bench.contact.friction
    asked = movement.reference[-1]
    missed, missed_without = (
        float(np.abs(run[-1] - asked).max() / asked.max())
        for run in (movement.with_friction, movement.without_friction)
    )
    free = np.where(movement.reference == 0.0, movement.without_friction, 0.0)
    ratio = min(movement.off_axis_with_friction / max(float(np.abs(free).max()), 1e-9), 1e3)
    off_axis = 1e3 * movement.off_axis_with_friction
    coulomb = ", ".join(f"{c:.3f}" for c in friction.coulomb)
    balancing = ", ".join(f"{c:.3f}" for c in bench.identified.friction.coulomb)
    at_end = "fraction of the angle missed at the end"
    other = "the same over that without friction, 1e-9 rad at least"
    aside = "friction moves the ball about axes that were not commanded"
    return Item(
        title="The ball on the clamped wheels, one axis commanded at a time",
        thesis="Without friction the ball follows without a steady error; with friction it does not, and it "
        "moves about several axes although one is commanded.",
        ours="The friction is that of drivelines and contacts, identified with the robot upside down as section 3.2 "
        f"has it (c = {coulomb} N m), not the one of balancing (c = {balancing} N m), which is another and holds "
        "under the robot's weight. At the end the ball misses less than 0.001 % of the commanded angle without "
        f"friction and {100.0 * missed:.3g} % with; about an uncommanded axis it turns by up to "
        f"{off_axis:.0f} mrad with friction.",
        checks=(
            check("without friction there is no steady error", at_end, missed_without, highest=1e-5),
            check("with friction there is one", at_end, missed, lowest=0.05),
            check(aside, "largest turn about one with friction", off_axis, "mrad", lowest=5.0),
            check("and does so more than the controller alone", other, ratio, lowest=10.0),
        ),
        series=movement.series,
    )


def figure_3_5(bench: Bench) -> Item:
    """The models about the origin under the same LQR, from a small lean."""
    late = {
        name: [1e3 * float(position_error(log)[log.t >= 0.5 * log.t[-1]].max()) for log in logs]
        for name, logs in bench.standing.items()
    }
    largest = "its largest distance in the last half minute"
    still = (
        check(
            f"the basic model stands still at the origin ({BASIC[name]})",
            largest,
            late[name],
            "mm",
            highest=1e-3,
        )
        for name in BASIC
    )
    return Item(
        title="The models with and without friction, holding the origin from a small lean",
        thesis="The basic model goes to the origin at once and stays, so that its path is not seen; the one "
        "with friction moves around the origin.",
        ours=f"In the second half of a minute, from leans of {1e3 * FIRST_LEAN:g} mrad to {RUNS} sides, the basic "
        "model is within a micrometre of the origin, by the exact equations and by the thesis's own; the one with "
        f"friction is up to {over_runs(late['friction'])} mm from it.",
        checks=(
            *still,
            check("the model with friction moves around it", largest, late["friction"], "mm", lowest=20.0),
        ),
        series=lambda: _states({name: logs[0] for name, logs in bench.standing.items()}, ("x", "y")),
    )


def _torque_at(sweep: Sweep, speed: float) -> float:
    """Return the mean size of the torque at which a wheel turns about that fast, either way [N m]."""
    near = np.abs(np.abs(sweep.speed) - speed) < _NEAR
    return float(np.abs(sweep.torque[near]).mean())


# --- chapter 4, validation --------------------------------------------------------------------------

#: (4.1) with friction and without, as Tables 4.1 and 4.2 print them, in the order of the states
TABLE_4_1 = (
    (0.0037, 0.0027, 0.0002, 0.0002, 0.0051, 0.0013, 0.0012, 0.0022, 0.0016, 0.0053),
    (0.0154, 0.0103, 0.0003, 0.0004, 0.0067, 0.0035, 0.0021, 0.0023, 0.0017, 0.0060),
)
TABLE_4_2 = (
    (0.0012, 0.0012, 0.0005, 0.0004, 0.0049, 0.0044, 0.0051, 0.0055, 0.0072, 0.0182),
    (0.0062, 0.0030, 0.0054, 0.0106, 0.0207, 0.0324, 0.0195, 0.0320, 0.0573, 0.0939),
)
#: above which a lean oscillates rather than balances [Hz]
_FAST_LEAN = 3.0
#: RMS error over the standard deviation from which on a state is not matched: a constant has 1
_NO_MATCH = 0.7
#: as drawn over time
_STATES = ("x", "y", "theta", "phi", "psi", "psi_dot")

#: ratios (10,) of a run: the error without friction over that with
Ratios = Callable[[Validated], Floats]


def figure_4_1(bench: Bench) -> Item:
    """Closed loop: measured states beside the models'."""
    validations = bench.validations
    closer = {name: _over(validations, _whole(1), name) for name in ("x", "y", "psi")}
    thesis = {name: over_runs(_over(validations, _whole(2), name)) for name in closer}
    missed = [float((run.rmse[0, 2:4] / np.std(run.log.states[:, 2:4], axis=0)).min()) for run in validations]
    shaken, truly = (
        list(ratios) for ratios in zip(*(_shaking(bench, k) for k in range(len(validations))), strict=True)
    )
    runs = {"measured": validations[0].log.without_truth()} | validations[0].runs
    whole = "error without friction over that with, whole run"
    of_lean = "RMS error of theta or phi with friction over its standard deviation, the smaller"
    fast = f"RMS of theta and phi above {_FAST_LEAN:g} Hz, measured over modelled"
    return Item(
        title="Closed loop: measured, and simulated with and without friction",
        thesis="With friction the model's x, y and psi are closer to what was measured; the lean matches "
        "neither model, and as measured it oscillates more.",
        ours="Over the whole run the error of x, y and psi without friction is "
        f"{', '.join(over_runs(values) for values in closer.values())} times that with (by the thesis's own equations "
        f"{', '.join(thesis.values())}). Theta and phi with friction err by {over_runs(missed)} of their standard "
        f"deviation. Above {_FAST_LEAN:g} Hz the measured lean moves {over_runs(shaken)} times as much as the model's "
        f"with friction, the true one {over_runs(truly)} times: most of it is the sensor.",
        checks=(
            *(
                check(f"{name} is closer with friction", whole, values, lowest=1.0)
                for name, values in closer.items()
            ),
            check("the lean matches neither model", of_lean, missed, lowest=_NO_MATCH),
            check("the measured lean oscillates more than the model's", fast, shaken, lowest=1.0),
        ),
        series=lambda: _states(runs, _STATES),
    )


def table_4_1(bench: Bench) -> Item:
    """Closed loop: (4.1) for each state, over the whole run and restarted."""
    runs = bench.validations
    ours = {
        "whole run": _whole(1),
        "thesis's equations": _whole(2),
        f"restarted every {RESTART:g} s": _restarted(1),
        "thesis's equations, restarted": _restarted(2),
    }
    return Item(
        title="Closed loop: the error (4.1) of each state",
        thesis="The model with friction has the smaller error in every state.",
        ours=f"Over the whole run, as in the thesis, {_better(runs, _whole(1))}; beside the thesis's own equations "
        f"without friction, {_better(runs, _whole(2))}. Over a whole run robot and model lose each other's phase. "
        f"Restarted from the measured state every {RESTART:g} s, {_better(runs, _restarted(1))}; beside the thesis's "
        f"own, {_better(runs, _restarted(2))}. The verdict is on the whole run. Ratios may be set beside the "
        "thesis's, sizes not: (4.1) shrinks with the length of a run (mistake 15).",
        checks=_table_checks(runs, _whole(1)),
        table=_table(TABLE_4_1, runs, ours),
    )


def figure_4_2(bench: Bench) -> Item:
    """Open loop: the models under the measured torques, each until its own lean is past recovery."""
    times = {name: [float(run.falls[k]) for run in bench.validations] for k, name in enumerate(MODELS)}
    exact, thesis = (_ratios(times["friction"], times[name]) for name in ("exact", "thesis"))
    later = "the lean of the model with friction runs away later"
    until = "time until past recovery, with over without"
    return Item(
        title="Open loop: measured, and simulated from the measured torques",
        thesis="Both models follow for a short while; the lean of the one with friction runs away later. Each is "
        "shown until its own lean is past recovery; only Table 4.2 cuts both to the shorter.",
        ours="From initial states a second apart, the lean is past recovery after "
        f"{over_runs(times['friction'])} s with friction, {over_runs(times['exact'])} s without and "
        f"{over_runs(times['thesis'])} s without by the thesis's own equations, which fall too slowly (mistake 5); "
        f"medians over these, {AHEAD:g} s at most. Each is drawn until its own lean is past recovery.",
        checks=(
            check(later, until, exact, lowest=1.0),
            check("and later than by the thesis's own equations", f"{until} by these", thesis, lowest=1.0),
            check(
                "both follow for a short while",
                "time of the model without friction",
                times["exact"],
                "s",
                0.2,
            ),
        ),
        series=lambda: _states(bench.validations[0].example, _STATES),
    )


def table_4_2(bench: Bench) -> Item:
    """Open loop: (4.1) for each state."""
    runs = bench.validations
    return Item(
        title="Open loop: the error (4.1) of each state",
        thesis="The model with friction has the smaller error in every state, both cut to the shorter.",
        ours=f"From initial states a second apart, both models cut to the shorter, {_better(runs, _opened(0))}; "
        f"beside the thesis's own equations without friction, {_better(runs, _opened(1))}. "
        "Ratios may be set beside the thesis's, sizes not (mistake 15).",
        checks=_table_checks(runs, _opened(0)),
        table=_table(TABLE_4_2, runs, {"without": _opened(0), "thesis's equations": _opened(1)}),
    )


def figure_4_3(bench: Bench) -> Item:
    """Correlation of the one-step residuals with each other and with the torques."""
    correlations = [run.correlations for run in bench.validations]
    x_phi, y_theta, named = velocity_pairs(correlations)
    clear = max(clear_correlation(run) for run in correlations)
    others = [_largest_other(run) for run in correlations]
    sizes = [size for size, _ in others]
    weaker = [min(abs(a), abs(b)) for a, b in zip(x_phi, y_theta, strict=True)]
    joined = "the ball's velocity goes with the body's rate of lean"
    return Item(
        title="Correlations of the prediction's residuals and the inputs",
        thesis="Residuals 7 and 9 go together, 6 and 9 oppositely: the ball's velocity with the body's rate "
        "of lean. All others are low.",
        ours=f"The ball's velocities go with the rates of lean, as (6, 9) with {over_runs(x_phi)} and (7, 8) with "
        f"{over_runs(y_theta)}; the thesis's pair (7, 9) has {over_runs(named)} (mistake 13). Of all other cells the "
        f"largest is {others[0][1]} with {over_runs(sizes)}: on board, a place is the sum of velocities.",
        checks=(
            check(joined, "the smaller of (6, 9) and (7, 8), its size", weaker, lowest=clear),
            check("7 and 9 go together", "their correlation", named, lowest=clear),
            check("6 and 9 go oppositely", "their correlation", x_phi, highest=-clear),
            check("all others are low", "the largest other", sizes, highest=0.5),
        ),
        figure=lambda: correlation_figure(
            symbols(correlations[0].labels), correlations[0].matrix, marked=correlations[0].significant
        ),
    )


def _whole(model: int) -> Ratios:
    return lambda run: run.whole[model] / run.whole[0]


def _restarted(model: int) -> Ratios:
    return lambda run: run.restarted[model] / run.restarted[0]


def _opened(pair: int) -> Ratios:
    return lambda run: run.open_loop[pair, 1] / run.open_loop[pair, 0]


def _over(runs: Sequence[Validated], ratios: Ratios, name: str) -> list[float]:
    return [float(ratios(run)[STATE_NAMES.index(name)]) for run in runs]


def _shaking(bench: Bench, number: int) -> tuple[float, float]:
    """Return how much more the measured and the true lean move at high frequency than the model's with friction."""
    run, h = bench.validations[number], bench.robot.sensors.sample_time
    true = bench.twin_changes("none")[number].truth().states
    modelled, shaken, truly = (
        rms(above(states[:, 2:4], h, _FAST_LEAN))
        for states in (run.runs["friction"].states, run.log.states, true)
    )
    return shaken / modelled, truly / modelled


def _largest_other(correlations: Correlations) -> tuple[float, str]:
    """Return the largest size of a cell off the diagonal but for velocity with rate of lean, and which it is."""
    sizes = np.abs(np.nan_to_num(correlations.matrix.copy()))
    np.fill_diagonal(sizes, 0.0)
    for i, j in ((5, 8), (6, 7), (5, 7), (6, 8)):
        sizes[i, j] = sizes[j, i] = 0.0
    i, j = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
    return float(sizes[i, j]), f"({i + 1}, {j + 1})"


def _better(runs: Sequence[Validated], ratios: Ratios) -> str:
    """Return in how many states friction lowers the error, and in how many that is sure."""
    table = np.array([ratios(run) for run in runs])
    sure = sum(median_with_interval(column).low > 1.0 for column in table.T.tolist())
    lower = int((np.median(table, axis=0) > 1.0).sum())
    return (
        f"friction lowers the error in {lower} of {table.shape[1]} states by the median of {len(runs)} runs, in "
        f"{sure} by the whole interval"
    )


def _table_checks(runs: Sequence[Validated], ratios: Ratios) -> tuple[ClaimCheck, ...]:
    quantity = "error without friction over that with"
    return tuple(
        check(
            f"the error of {name} is smaller with friction", quantity, _over(runs, ratios, name), lowest=1.0
        )
        for name in STATE_NAMES
    )


def _table(printed: Sequence[Sequence[float]], runs: Sequence[Validated], ours: dict[str, Ratios]) -> Sheet:
    return Sheet(
        headings=("state", "thesis: with friction", "without", "ratio", *(f"ours: {name}" for name in ours)),
        rows=tuple(
            (
                name,
                f"{with_friction:.4f}",
                f"{without:.4f}",
                f"{without / with_friction:.2f}",
                *(over_runs(_over(runs, ratios, name)) for ratios in ours.values()),
            )
            for name, with_friction, without in zip(STATE_NAMES, *printed, strict=True)
        ),
    )


# --- chapter 5, control with compensation -----------------------------------------------------------

#: what the thesis reads from Figure 5.8 [m]
THESIS_PEAKS = {"none": 1.0, "full": 0.2}
#: above which a wheel's speed oscillates rather than follows [Hz]
_FAST = 5.0
#: on the way, and past the jump that the step of the reference gives every wheel [s]
_MOVING = (3.5, 15.0)
#: what moves on a way without a turn
_IN_PLANE = ("x", "y", "theta", "phi", "x_dot", "y_dot", "theta_dot", "phi_dot")
#: early enough that a fresh run gets there soon [s]
EARLY = 10.0
#: how much more than another a number must be to be called more
_CLEARLY = 1.1
#: "almost completely overlapping": RMS difference over the state's range
_OVERLAPPING = 0.05
_WORDS = {"none": "without compensation", "full": "with compensation"}


def figure_5_1(bench: Bench) -> Item:
    """The linear model beside the nonlinear ones, and how they part as the lean grows."""
    linear, changes = bench.linear, bench.changes["none"]
    far = [apart(linear["exact"], log, "x") for log in changes]
    near: dict[Formulation, float] = {name: largest_apart(linear[name], bench.basic[name]) for name in BASIC}
    growth: dict[Formulation, list[float]] = {
        name: [largest_apart(*pair, _IN_PLANE) for pair in bench.parting[name]] for name in BASIC
    }
    leans = {name: [np.degrees(largest_lean(bent)) for _, bent in bench.parting[name]] for name in BASIC}
    rows = [
        (
            f"{step:g} m",
            *(cell for name in BASIC for cell in (f"{leans[name][k]:.1f} degrees", _share(growth[name][k]))),
        )
        for k, step in enumerate(STEPS)
    ]
    runs = {"linear": linear["exact"], **bench.basic, "friction": changes[0]}
    return Item(
        title="The linear model, and the nonlinear one with and without friction, through the change of "
        "reference",
        thesis="The linear and the nonlinear model almost completely overlap; they part more with a larger lean; "
        "friction changes the behaviour drastically.",
        ours=f"Of any state's range, linear and nonlinear model differ by at most {_share(near['exact'])} "
        f"(RMS), by the thesis's own equations {_share(near['thesis'])}. Without the turn, at a lean of up to "
        f"{leans['exact'][0]:.1f} degrees, they differ by {_share(growth['exact'][0])}, {STEPS[-1]:g} times as "
        f"far, at {leans['exact'][-1]:.1f} degrees, by {_share(growth['exact'][-1])}. With friction x is off by "
        f"{over_runs([100.0 * share for share in far])} %.",
        checks=_linear_checks(near, growth, far),
        table=Sheet(
            headings=(
                "way",
                "lean",
                "linear and nonlinear differ by",
                "lean, thesis's equations",
                "differ by",
            ),
            rows=tuple(rows),
        ),
        series=lambda: _states(runs, _STATES, end=20.0),
    )


def _linear_checks(
    near: Mapping[Formulation, float], growth: Mapping[Formulation, Sequence[float]], far: Sequence[float]
) -> tuple[ClaimCheck, ...]:
    """Return the checks of Figure 5.1: differences along the reference, their growth with the lean, and friction's."""
    largest = "largest RMS difference of a state, of its range"
    ratio = "smallest ratio of a difference to the one before, the way doubled each time"
    drastic = "friction changes the behaviour drastically"
    of_x = "RMS difference of x with friction, of its range"
    grown: dict[Formulation, float]
    grown = {name: float(np.min(np.divide(values[1:], values[:-1]))) for name, values in growth.items()}
    return (
        *(
            check(
                f"the linear and the nonlinear model overlap ({BASIC[name]})",
                largest,
                value,
                highest=_OVERLAPPING,
            )
            for name, value in near.items()
        ),
        *(
            check(f"they part more with a larger lean ({BASIC[name]})", ratio, value, lowest=_CLEARLY)
            for name, value in grown.items()
        ),
        check(drastic, of_x, far, lowest=2.0 * _OVERLAPPING),
    )


def figure_5_4(bench: Bench) -> Item:
    """Full and partial compensation: the position."""
    errors = {
        law: [
            [1e3 * steady_error(log) for log in bench.changes[kind + suffix]] for kind in ("full", "partial")
        ]
        for law, suffix in (("bare sign", "_sign"), ("ramp", ""))
    }
    sign, ramp = ([over_runs(values) for values in errors[law]] for law in errors)
    less = {law: _ratios(full, partial) for law, (full, partial) in errors.items()}
    size = {law: [abs(a - b) for a, b in zip(*pair, strict=True)] for law, pair in errors.items()}
    shown = {kind: bench.changes[kind][0] for kind in ("full", "partial", "full_sign", "partial_sign")}
    return Item(
        title="Full compensation (1 in the thesis) and partial compensation (2)",
        thesis="Partial compensation has less steady error than full; the difference is small for the "
        "application.",
        ours=f"With a bare sign, as the thesis has it, the error over the last 5 s is {sign[0]} mm with "
        f"full and {sign[1]} mm with partial compensation; with the controller's ramp {ramp[0]} and "
        f"{ramp[1]} mm: the ramp gives full compensation what partial has over it.",
        checks=(
            *(
                check(
                    f"with a {law} partial compensation has less steady error",
                    "full over partial",
                    ratios,
                    "",
                    _CLEARLY,
                )
                for law, ratios in less.items()
            ),
            *(
                check(f"with a {law} the difference is small", "its size", differences, "mm", highest=50.0)
                for law, differences in size.items()
            ),
        ),
        series=lambda: _states({"linear": bench.linear["exact"], **shown}, ("x", "y")),
    )


def figure_5_5(bench: Bench) -> Item:
    """Full and partial compensation: the wheels' speeds."""
    kinds = ("full", "partial", "full_sign", "partial_sign")
    fast = {kind: [1e3 * _fast_moving(bench, log) for log in bench.changes[kind]] for kind in kinds}
    more, ratio = f"RMS above {_FAST:g} Hz, partial over full", _ratios(fast["partial"], fast["full"])
    return Item(
        title="The wheels' speeds with full and with partial compensation",
        thesis="Partial compensation shows more oscillation of high frequency.",
        ours=f"On the way, above {_FAST:g} Hz, the wheels' speed has {over_runs(fast['full'])} mrad/s (RMS) with full "
        f"and {over_runs(fast['partial'])} mrad/s with partial compensation (with a bare sign "
        f"{over_runs(fast['full_sign'])} and {over_runs(fast['partial_sign'])}): partial compensation switches as a "
        "wheel turns from driving to braking. The linear model, which knows no heading, is left out.",
        checks=(check("partial compensation oscillates more", more, ratio, lowest=_CLEARLY),),
        series=lambda: _wheels(bench),
    )


def figure_5_6(bench: Bench) -> Item:
    """The models' paths with and without compensation."""
    peaks = {
        k: [1e3 * peak_after_arrival(log) for log in bench.changes[k]] for k in ("none", "full", "full_sign")
    }
    ways = _ways(bench, bench.changes)
    nearer = "on the way compensation keeps it nearer to the linear model's path"
    farther = _ratios(peaks["none"], peaks["full"])
    from_path = "largest distance from that path, without over with"
    return Item(
        title="Paths of the model with and without compensation",
        thesis="With compensation the model follows the reference with small deviations; without it does "
        "not.",
        ours=f"From t = {ARRIVED:g} s on, when the approach is over, the model is at most {over_runs(peaks['full'])} "
        f"mm from the reference with compensation and {over_runs(peaks['none'])} mm without. With a bare sign it is "
        f"{over_runs(peaks['full_sign'])} mm: a robot that sticks stays where it stopped. On the way its path is at "
        f"most {over_runs(ways['full'])} mm from that of the linear model with compensation, "
        f"{over_runs(ways['none'])} mm without.",
        checks=(
            check(
                "with compensation deviations are small",
                "largest distance after arrival",
                peaks["full"],
                "mm",
                highest=100.0,
            ),
            check(
                "without compensation it does not follow",
                "largest distance without over that with",
                farther,
                lowest=2.0,
            ),
            check(nearer, from_path, _ratios(ways["none"], ways["full"]), lowest=_CLEARLY),
        ),
        figure=lambda: paths_figure({candidate_name(kind): bench.changes[kind][0] for kind in _WORDS}),
    )


def figure_5_8(bench: Bench) -> Item:
    """The twin's distance from the reference over time."""
    runs = {"none": bench.twin_changes("none"), "full": bench.twin_changes("full")}
    peaks = {kind: [peak_after_arrival(log) for log in logs] for kind, logs in runs.items()}
    simulated, ways = [peak_after_arrival(log) for log in bench.changes["full"]], _ways(bench, runs)
    ratios = _ratios(peaks["none"], peaks["full"])
    less = "the robot follows less closely than the model"
    measured = "the twin's largest distance over the model's"
    about = (
        check(
            f"{_WORDS[kind]} the peak error is about {peak:g} m",
            "largest distance after arrival",
            peaks[kind],
            "m",
            0.5 * peak,
            2.0 * peak,
        )
        for kind, peak in THESIS_PEAKS.items()
    )
    return Item(
        title="The robot's (here the twin's) distance from the reference, with and without compensation",
        thesis="Once the reference is reached the error peaks at about 1 m without compensation and 0.2 m "
        "with: compensation helps the robot too, but it does not follow as closely as in simulation.",
        ours=f"{over_runs(peaks['none'])} m and {over_runs(peaks['full'])} m, a ratio of {over_runs(ratios)} where the "
        f"thesis has 5; the compensated model {over_runs(simulated)} m. On the way the twin's path is at most "
        f"{over_runs(ways['full'])} mm from that of the linear model with compensation, {over_runs(ways['none'])} mm "
        "without. The thesis prints neither its gain nor its friction; what is frozen here is the nominal scenario.",
        checks=(
            *about,
            check(
                "compensation makes the peak several times smaller",
                "the one over the other",
                ratios,
                "",
                2.5,
                10.0,
            ),
            check(less, measured, _ratios(peaks["full"], simulated), lowest=1.0),
        ),
        table=_runs_table(runs, peaks),
        series=lambda: position_error_series(
            {candidate_name(kind): logs[0] for kind, logs in runs.items()}, ""
        ),
    )


def _runs_table(runs: Mapping[str, Sequence[Log]], peaks: Mapping[str, Sequence[float]]) -> Sheet:
    """Return each run's distance early on, which a fresh run can be held against soon, and its peak."""
    measured = (f"distance at {EARLY:g} s", "peak")
    cells = [
        [f"{value:.3f}" for kind in _WORDS for value in (distance_at(runs[kind][k], EARLY), peaks[kind][k])]
        for k in range(len(peaks["none"]))
    ]
    return Sheet(
        headings=("run", *(f"{words}, {what} [m]" for words in _WORDS.values() for what in measured)),
        rows=tuple((f"{k}", *row) for k, row in enumerate(cells)),
    )


def _ways(bench: Bench, runs: Mapping[str, Sequence[Log]]) -> dict[str, list[float]]:
    """Return how far the paths are from the linear model's on the way [mm]."""
    return {kind: [1e3 * way_apart(bench.linear["exact"], log) for log in runs[kind]] for kind in _WORDS}


def _fast_moving(bench: Bench, log: Log) -> float:
    """Return the RMS [rad/s] of what of the wheels' speeds is fast while the robot is on its way."""
    fast = above(log.wheel_speeds, bench.robot.sensors.sample_time, _FAST)
    return rms(fast[(log.t >= _MOVING[0]) & (log.t < _MOVING[1])])


def _ratios(first: Sequence[float], second: Sequence[float]) -> list[float]:
    return [a / b for a, b in zip(first, second, strict=True)]


def _share(value: float) -> str:
    return f"{100.0 * value:.2g} %"


# --- appendices III and IV --------------------------------------------------------------------------

#: what the swing gave, by Appendix III [kg m^2]
THESIS_INERTIA = 4.37
#: the thesis's drift of the heading: 16 degrees in 3 minutes [deg]
THESIS_DRIFT, MINUTES = 16.0, 3.0
#: first and last part of the run that are held beside each other [s]
_PART = 30.0


def figure_iii_1(bench: Bench) -> Item:
    """The body hung up at the ball's centre and let swing, in simulation."""
    fit = bench.swings[0]
    inertias = [inertia_of_swing(swing, bench.robot) for swing in bench.swings]
    pivots = [inertia.about_pivot.value for inertia in inertias]
    half, about_center = inertias[0].about_pivot.half_width, inertias[0].about_center_of_mass
    off = [100.0 * abs(pivot / THESIS_INERTIA - 1.0) for pivot in pivots]
    claim = "the method finds the inertia that was simulated, 4.37 kg m^2"
    return Item(
        title="The body's inertia from a simulated swing",
        thesis="The thesis shows a frame of the video of the hanging body, and gives 4.37 kg m^2 by I = m g "
        "r / omega_n^2; neither the frequency nor an uncertainty is printed.",
        ours=f"A body of that inertia swings at {fit.frequency:.4f} rad/s, with a period of "
        f"{2.0 * math.pi / fit.frequency:.4f} s. Nothing was filmed: the angles are simulated by a pendulum of that "
        f"inertia, {fit.swing.swings:.0f} swings at 30 samples a second with an error of 3 mrad each. From each of "
        f"{len(inertias)} such records `ballbot check --swing` finds {over_runs(pivots)} kg m^2 about the pivot, the "
        f"first to ± {half:.1g}, and {about_center.value:.3f} about the centre of mass. That tests the method, not the "
        "thesis's number.",
        checks=(check(claim, "found from the swing, its difference from that", off, "%", highest=0.1),),
        series=lambda: swing_series(fit, label="simulated, with the tracking's error"),
    )


def figure_iv_2(bench: Bench) -> Item:
    """The angles' errors."""
    sensors = _sensors(bench)
    largest = [
        max(float(np.degrees(error.of[name].largest)) for name in ("theta", "phi")) for error in sensors
    ]
    drift = [float(np.degrees(abs(error.of["psi"].drift))) * 60.0 * MINUTES for error in sensors]
    peak = "theta's and phi's errors peak just over 1 degree"
    drifts = "the heading drifts by about 16 degrees in 3 minutes"
    return Item(
        title="The angles' errors",
        thesis="Theta's and phi's errors peak just over 1 degree at the worst; the heading drifts by about "
        "16 degrees in 3 minutes.",
        ours=f"The largest error of theta and phi is {over_runs(largest)} degrees; the heading drifts by "
        f"{over_runs(drift)} degrees in 3 minutes.",
        checks=(
            check(peak, "the largest", largest, "deg", 0.5, 2.0),
            check(drifts, "drift", drift, "deg", 0.9 * THESIS_DRIFT, 1.1 * THESIS_DRIFT),
        ),
        series=lambda: errors_series(bench.alignments[0], sensors[0], ("theta", "phi", "psi")),
    )


def figure_iv_4(bench: Bench) -> Item:
    """The position's errors, and what of them the heading's error makes."""
    sensors = _sensors(bench)
    shares = [error.position.by_heading for error in sensors if error.position is not None]
    first, last = (list(part) for part in zip(*map(_away, bench.alignments), strict=True))
    follows = [_crossed(alignment) for alignment in bench.alignments]
    early, late = f"largest distance in the first {_PART:g} s", "the last part's largest over the first's"
    crossed = "each error goes with the other coordinate's movement"
    return Item(
        title="The position's errors",
        thesis="The positions match well in the beginning; the errors drift and oscillate; that of x goes with the "
        "movement in y and that of y with x, which shows that the heading's drift makes them.",
        ours=f"They differ by at most {over_runs(first)} mm in the first {_PART:g} s and {over_runs(last)} mm "
        "in the last. In the last minute the smaller of the errors' correlations with the other coordinate is "
        f"{over_runs(follows)}; the heading's error explains {over_runs([100.0 * share for share in shares])} % of the "
        "position error's square.",
        checks=(
            check("they match in the beginning", early, first, "mm", highest=100.0),
            check("they drift apart", late, _ratios(last, first), lowest=2.0),
            check(crossed, "the smaller correlation", follows, lowest=0.5),
            check(
                "the heading's drift makes them",
                "share of the error's square that it explains",
                shares,
                lowest=0.5,
            ),
        ),
        series=lambda: errors_series(bench.alignments[0], sensors[0], ("x", "y")),
    )


def _sensors(bench: Bench) -> list[SensorErrors]:
    # the twin's log has angles and the cameras see them
    return [alignment.sensors for alignment in bench.alignments if alignment.sensors is not None]


def _away(alignment: Alignment) -> tuple[float, float]:
    """Return the largest distance between the two positions in the first and in the last part [mm]."""
    assert alignment.sensors is not None  # as in `_sensors`
    away, t = np.hypot(alignment.sensors.errors["x"], alignment.sensors.errors["y"]), alignment.log.t
    first, last = np.nanmax(away[t <= t[0] + _PART]), np.nanmax(away[t >= t[-1] - _PART])
    return 1e3 * float(first), 1e3 * float(last)


def _crossed(alignment: Alignment) -> float:
    """Return the smaller correlation of an error with the other coordinate, late, when the heading is far off."""
    assert alignment.sensors is not None  # as in `_sensors`
    errors = alignment.sensors.errors
    table = np.array([errors["x"], alignment.log["mocap_y"], errors["y"], alignment.log["mocap_x"]])
    table = table[:, (alignment.log.t >= alignment.log.t[-1] - 2.0 * _PART) & np.isfinite(table).all(axis=0)]
    matrix = np.asarray(np.corrcoef(table))
    return float(min(abs(matrix[0, 1]), abs(matrix[2, 3])))


# --- drawings ---------------------------------------------------------------------------------------

#: runs by name: their label and look
_SHOWN: Mapping[str, tuple[str, Look]] = {
    "measured": ("measured", "measured"),
    "linear": ("linear", "measured"),
    "friction": ("model with friction", "first"),
    "exact": ("no friction, exact", "second"),
    "thesis": ("no friction, thesis's equations", "third"),
    "full": ("full compensation", "first"),
    "partial": ("partial compensation", "third"),
    "full_sign": ("full, bare sign", "fourth"),
    "partial_sign": ("partial, bare sign", "fifth"),
}


def _states(runs: Mapping[str, Log], names: Sequence[str], *, end: float = math.inf) -> TimeSeries:
    """Return states of some runs up to a time [s], with the reference where there is one."""
    runs = {kind: log.between(-math.inf, end) for kind, log in runs.items()}
    longest = max(runs.values(), key=len)
    panels = []
    for name in names:
        _, lines = together([(*_SHOWN[kind], log.t, log[name]) for kind, log in runs.items()])
        if f"ref_{name}" in longest:
            lines.append(Line("reference", longest[f"ref_{name}"], "reference"))
        panels.append(Panel(f"{state_mark(name)} [{STATE_UNITS[name]}]", lines))
    return TimeSeries(longest.t, panels, "")


def _wheels(bench: Bench) -> TimeSeries:
    """Return the wheels' speeds with full and partial compensation, and what of them is fast."""
    first, last = 2.5, 8.0
    logs = {kind: bench.changes[kind][0] for kind in ("full", "partial")}
    t = logs["full"].t
    rows, on_way = (t >= first) & (t <= last), (t >= _MOVING[0]) & (t <= last)
    fast = {
        kind: 1e3 * above(log.wheel_speeds, bench.robot.sensors.sample_time, _FAST)
        for kind, log in logs.items()
    }
    reach = 1.2 * max(float(np.abs(speeds[on_way]).max()) for speeds in fast.values())
    panels = []
    for wheel in range(bench.robot.wheel_count):
        whole, part = (
            [Line(_SHOWN[kind][0], values[rows, wheel], _SHOWN[kind][1]) for kind, values in speeds.items()]
            for speeds in ({kind: log.wheel_speeds for kind, log in logs.items()}, fast)
        )
        # the step's jump goes beyond
        fine = Panel(f"above {_FAST:g} Hz [mrad/s]", part, ends=(-reach, reach))
        panels += [Panel(f"wheel {wheel + 1} [rad/s]", whole), fine]
    return TimeSeries(t[rows], panels, "")


def torque_speed_figure(sweep: Sweep, fit: DrivelineFit) -> Figure:
    """Return the thesis's Figure 3.2 as a torque-speed characteristic."""
    figure, axes = one_panel(f"speed of wheel {sweep.wheel} [rad/s]", "torque [N m]")
    torque, measured, predicted, without = thinned(sweep.torque, sweep.speed, fit.predicted, fit.without)
    # a broad pale line beneath, for the model's with friction lies on it
    axes.plot(measured, torque, label="measured", **{**LOOKS["reference"], "linewidth": 3.2})
    axes.plot(without, torque, label="without friction", **LOOKS["second"])
    axes.plot(predicted, torque, label="with friction", **LOOKS["first"])
    axes.legend(loc="upper left")
    return figure


#: by their names in the thesis, in its order
ITEMS: Mapping[str, Callable[[Bench], Item]] = {
    "Figure 3.1": figure_3_1,
    "Figure 3.2": figure_3_2,
    "Figure 3.4": figure_3_4,
    "Figure 3.5": figure_3_5,
    "Figure 4.1": figure_4_1,
    "Table 4.1": table_4_1,
    "Figure 4.2": figure_4_2,
    "Table 4.2": table_4_2,
    "Figure 4.3": figure_4_3,
    "Figure 5.1": figure_5_1,
    "Figure 5.4": figure_5_4,
    "Figure 5.5": figure_5_5,
    "Figure 5.6": figure_5_6,
    "Figure 5.8": figure_5_8,
    "Figure III.1": figure_iii_1,
    "Figure IV.2": figure_iv_2,
    "Figure IV.4": figure_iv_4,
}

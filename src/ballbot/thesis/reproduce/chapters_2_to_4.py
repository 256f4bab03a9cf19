"""Chapters 2 (basic model), 3 (friction) and 4 (validation): Figures 2.1 to 4.3, Tables 4.1 and 4.2."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.driveline import Sweep
from ballbot.log import STATE_NAMES, Log
from ballbot.report.bench import movement_figure
from ballbot.report.driveline import measured_figure, torque_speed_figure
from ballbot.report.style import MEASURED, WITH_FRICTION, WITHOUT_FRICTION
from ballbot.report.validation_figures import correlation_figure, symbols
from ballbot.thesis.reproduce.bench import BASIC, FIRST_LEAN, Bench
from ballbot.thesis.reproduce.drawing import (
    BASIC_LABELS,
    THESIS_EQUATIONS,
    Shown,
    coordinates_figure,
    panels_figure,
    paths_figure,
    state_panels,
)
from ballbot.thesis.reproduce.item import RUNS, Check, Item, Rows, over_runs
from ballbot.thesis.reproduce.mistakes import clear_correlation, velocity_pairs
from ballbot.thesis.reproduce.runs import AHEAD, MODELS, RESTART, Validated, above
from ballbot.validation.statistics import Correlations
from ballbot.workflows.comparison import median_with_interval
from ballbot.workflows.metrics import position_error, rms


def figure_2_1(bench: Bench) -> Item:
    """The robot's frame and its generalised coordinates, a drawing."""
    return Item(
        name="Figure 2.1",
        title="The robot and its generalised coordinates",
        thesis="The thesis draws the robot with x and y of the ball on the floor and theta, phi and psi of "
        "the body.",
        ours=f"Ours is drawn to scale from the parameters of Appendix III ({bench.robot.name}), from its "
        "right and from above, with the same coordinates: x forward, y left, z up, and R = Rx(theta) "
        "Ry(phi) Rz(psi).",
        figure=lambda: coordinates_figure(bench.robot),
    )


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
    return Item(
        name="Figure 3.1",
        title="Torque and speed of the wheels, without the ball, under 1 N m at a period of 62.83 s",
        thesis="All three wheels have roughly the same characteristic, with a speed limit at 27.7 rad/s.",
        ours=f"The twin's wheels reach {fastest:.2f} rad/s; at {_SPEED:g} rad/s they take "
        f"{', '.join(f'{torque:.3f}' for torque in torques)} N m.",
        checks=(
            Check(
                "the speed limit is at 27.7 rad/s",
                "greatest speed of a wheel",
                fastest,
                "rad/s",
                lowest=0.99 * THESIS_LIMIT,
                highest=1.01 * THESIS_LIMIT,
            ),
            Check(
                "all wheels are roughly the same",
                f"spread of their torques at {_SPEED:g} rad/s, of the largest",
                spread,
                highest=_ROUGHLY,
            ),
        ),
        figure=lambda: measured_figure(bench.sweeps),
    )


def figure_3_2(bench: Bench) -> Item:
    """One wheel's sweep beside the models with and without friction."""
    fit, sweep = bench.driveline_fit, bench.sweeps[0]
    b, c = fit.values[:2]
    speed = np.abs(sweep.speed[sweep.speed != 0.0])
    share = float(np.sum(b * speed + c) / np.sum(fit.law.steady_friction(speed)))
    return Item(
        name="Figure 3.2",
        title="One wheel's sweep: measured, with and without friction in the model",
        thesis="The model with friction is closer to the measurement than the one without; most of the "
        "friction is viscous and Coulomb.",
        ours=f"Over the sweep the speed errs by {fit.rmse:.2f} rad/s with the friction found (where the "
        f"supply does not limit it) and by {fit.rmse_without:.2f} rad/s without, whose clamp (3.2) winds up "
        "and holds the wheel at the limit while the torque brakes (mistake 9); viscous and Coulomb friction "
        f"are {100.0 * share:.0f} % of it, summed over the sweep.",
        checks=(
            Check(
                "the model with friction is closer",
                "RMS error without friction over that with",
                fit.rmse_without / fit.rmse,
                lowest=1.0,
            ),
            Check("most of the friction is viscous and Coulomb", "their share", share, lowest=0.5),
        ),
        figure=lambda: torque_speed_figure(sweep, fit),
    )


def figure_3_4(bench: Bench) -> Item:
    """The ball on the clamped wheels under its own LQR."""
    movement, friction = bench.ball_movement, bench.contact.friction
    asked = movement.reference[-1]
    missed = {
        name: float(np.abs(run.rotations[-1] - asked).max() / asked.max())
        for name, run in (("with", movement.with_friction), ("without", movement.without_friction))
    }
    free = np.where(movement.reference == 0.0, movement.without_friction.rotations, 0.0)
    ratio = movement.off_axis_with_friction / max(float(np.abs(free).max()), 1e-9)
    coulomb = ", ".join(f"{c:.3f}" for c in friction.coulomb)
    balancing = ", ".join(f"{c:.3f}" for c in bench.identified.friction.coulomb)
    return Item(
        name="Figure 3.4",
        title="The ball on the clamped wheels, one axis commanded at a time",
        thesis="Without friction the ball follows without a steady error; with friction it does not, and it "
        "moves about several axes although one is commanded.",
        ours="The friction is that of drivelines and contacts, identified with the robot upside down as section 3.2 "
        f"has it (c = {coulomb} N m), not the one of balancing (c = {balancing} N m), which is another and holds "
        "under the robot's weight. At the end the ball misses less than 0.001 % of the commanded angle without "
        f"friction and {100.0 * missed['with']:.3g} % with; about an uncommanded axis it turns by up to "
        f"{1e3 * movement.off_axis_with_friction:.0f} mrad with friction.",
        checks=(
            Check(
                "without friction there is no steady error",
                "fraction of the angle missed at the end",
                missed["without"],
                highest=1e-5,
            ),
            Check(
                "with friction there is one",
                "fraction of the angle missed at the end",
                missed["with"],
                lowest=0.05,
            ),
            Check(
                "friction moves the ball about axes that were not commanded",
                "largest turn about one with friction",
                1e3 * movement.off_axis_with_friction,
                "mrad",
                lowest=5.0,
            ),
            Check(
                "and does so more than the controller alone",
                "the same over that without friction, 1e-9 rad at least",
                min(ratio, 1e3),
                lowest=10.0,
            ),
        ),
        figure=lambda: movement_figure(movement),
    )


def figure_3_5(bench: Bench) -> Item:
    """The models about the origin under the same LQR, from a small lean."""
    late = {
        name: [1e3 * float(position_error(log)[log.t >= 0.5 * log.t[-1]].max()) for log in logs]
        for name, logs in bench.standing.items()
    }
    shown = _shown({name: logs[0] for name, logs in bench.standing.items()})
    return Item(
        name="Figure 3.5",
        title="The models with and without friction, holding the origin from a small lean",
        thesis="The basic model goes to the origin at once and stays, so that its path is not seen; the one "
        "with friction moves around the origin.",
        ours=f"In the second half of a minute, from leans of {1e3 * FIRST_LEAN:g} mrad to {RUNS} sides, the basic "
        "model is within a micrometre of the origin, by the exact equations and by the thesis's own; the one with "
        f"friction is up to {over_runs(late['friction'])} mm from it.",
        checks=(
            *(
                Check.over(
                    f"the basic model stands still at the origin ({BASIC[name]})",
                    "its largest distance in the last half minute",
                    late[name],
                    "mm",
                    highest=1e-3,
                )
                for name in BASIC
            ),
            Check.over(
                "the model with friction moves around it",
                "its largest distance in the last half minute",
                late["friction"],
                "mm",
                lowest=20.0,
            ),
        ),
        figure=lambda: paths_figure(shown, ball_radius=bench.robot.ball.radius, goal=False),
    )


def _torque_at(sweep: Sweep, speed: float) -> float:
    """Return the mean size of the torque at which a wheel turns about that fast, either way [N m]."""
    near = np.abs(np.abs(sweep.speed) - speed) < _NEAR
    return float(np.abs(sweep.torque[near]).mean())


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
_FAST = 3.0
#: RMS error over the standard deviation from which on a state is not matched: a constant has 1
_NO_MATCH = 0.7

#: ratios (10,) of a run: the error without friction over that with
Ratios = Callable[[Validated], NDArray[np.float64]]


def figure_4_1(bench: Bench) -> Item:
    """Closed loop: measured states beside the models'."""
    found = bench.validations
    closer = {name: _over(found, _whole(1), name) for name in ("x", "y", "psi")}
    thesis = {name: over_runs(_over(found, _whole(2), name)) for name in closer}
    missed = [float((one.rmse[0, 2:4] / np.std(one.log.states[:, 2:4], axis=0)).min()) for one in found]
    shaken, truly = (
        list(ratios) for ratios in zip(*(_shaking(bench, k) for k in range(len(found))), strict=True)
    )
    runs = {"measured": found[0].log.without_truth()} | found[0].runs
    return Item(
        name="Figure 4.1",
        title="Closed loop: measured, and simulated with and without friction",
        thesis="With friction the model's x, y and psi are closer to what was measured; the lean matches "
        "neither model, and as measured it oscillates more.",
        ours="Over the whole run the error of x, y and psi without friction is "
        f"{', '.join(over_runs(one) for one in closer.values())} times that with (by the thesis's own equations "
        f"{', '.join(thesis.values())}). Theta and phi with friction err by {over_runs(missed)} of their standard "
        f"deviation. Above {_FAST:g} Hz the measured lean moves {over_runs(shaken)} times as much as the model's with "
        f"friction, the true one {over_runs(truly)} times: most of it is the sensor.",
        checks=(
            *(
                Check.over(
                    f"{name} is closer with friction",
                    "error without friction over that with, whole run",
                    values,
                    lowest=1.0,
                )
                for name, values in closer.items()
            ),
            Check.over(
                "the lean matches neither model",
                "RMS error of theta or phi with friction over its standard deviation, the smaller",
                missed,
                lowest=_NO_MATCH,
            ),
            Check.over(
                "the measured lean oscillates more than the model's",
                f"RMS of theta and phi above {_FAST:g} Hz, measured over modelled",
                shaken,
                lowest=1.0,
            ),
        ),
        figure=lambda: panels_figure(state_panels(_shown(runs), _STATES), columns=2),
    )


def table_4_1(bench: Bench) -> Item:
    """Closed loop: (4.1) for each state, over the whole run and restarted."""
    found = bench.validations
    return Item(
        name="Table 4.1",
        title="Closed loop: the error (4.1) of each state",
        thesis="The model with friction has the smaller error in every state.",
        ours=f"Over the whole run, as in the thesis, {_better(found, _whole(1))}; beside the thesis's own equations "
        f"without friction, {_better(found, _whole(2))}. Over a whole run robot and model lose each other's phase. "
        f"Restarted from the measured state every {RESTART:g} s, {_better(found, _restarted(1))}; beside the thesis's "
        f"own, {_better(found, _restarted(2))}. The verdict is on the whole run. Ratios may be set beside the "
        "thesis's, sizes not: (4.1) shrinks with the length of a run (mistake 15).",
        checks=_table_checks(found, _whole(1)),
        table=_table(
            TABLE_4_1,
            found,
            {
                "whole run": _whole(1),
                "thesis's equations": _whole(2),
                f"restarted every {RESTART:g} s": _restarted(1),
                "thesis's equations, restarted": _restarted(2),
            },
        ),
    )


def figure_4_2(bench: Bench) -> Item:
    """Open loop: the models under the measured torques, each until its own lean is past recovery."""
    times = {name: [float(one.falls[k]) for one in bench.validations] for k, name in enumerate(MODELS)}
    later = {
        name: [a / b for a, b in zip(times["friction"], times[name], strict=True)]
        for name in ("exact", "thesis")
    }
    return Item(
        name="Figure 4.2",
        title="Open loop: measured, and simulated from the measured torques",
        thesis="Both models follow for a short while; the lean of the one with friction runs away later. Each is "
        "shown until its own lean is past recovery; only Table 4.2 cuts both to the shorter.",
        ours="From initial states a second apart, the lean is past recovery after "
        f"{over_runs(times['friction'])} s with friction, {over_runs(times['exact'])} s without and "
        f"{over_runs(times['thesis'])} s without by the thesis's own equations, which fall too slowly (mistake 5); "
        f"medians over these, {AHEAD:g} s at most. Each is drawn until its own lean is past recovery.",
        checks=(
            Check.over(
                "the lean of the model with friction runs away later",
                "time until past recovery, with over without",
                later["exact"],
                lowest=1.0,
            ),
            Check.over(
                "and later than by the thesis's own equations",
                "time until past recovery, with over without by these",
                later["thesis"],
                lowest=1.0,
            ),
            Check.over(
                "both follow for a short while",
                "time of the model without friction",
                times["exact"],
                "s",
                lowest=0.2,
            ),
        ),
        figure=lambda: panels_figure(state_panels(_shown(bench.validations[0].example), _STATES), columns=2),
    )


def table_4_2(bench: Bench) -> Item:
    """Open loop: (4.1) for each state."""
    found = bench.validations
    return Item(
        name="Table 4.2",
        title="Open loop: the error (4.1) of each state",
        thesis="The model with friction has the smaller error in every state, both cut to the shorter.",
        ours=f"From initial states a second apart, both models cut to the shorter, {_better(found, _opened(0))}; "
        f"beside the thesis's own equations without friction, {_better(found, _opened(1))}. "
        "Ratios may be set beside the thesis's, sizes not (mistake 15).",
        checks=_table_checks(found, _opened(0)),
        table=_table(TABLE_4_2, found, {"without": _opened(0), "thesis's equations": _opened(1)}),
    )


def figure_4_3(bench: Bench) -> Item:
    """Correlation of the one-step residuals with each other and with the torques."""
    found = [one.correlations for one in bench.validations]
    x_phi, y_theta, named = velocity_pairs(found)
    clear = max(clear_correlation(one) for one in found)
    others = [_largest_other(one) for one in found]
    weaker = [min(abs(a), abs(b)) for a, b in zip(x_phi, y_theta, strict=True)]
    return Item(
        name="Figure 4.3",
        title="Correlations of the prediction's residuals and the inputs",
        thesis="Residuals 7 and 9 go together, 6 and 9 oppositely: the ball's velocity with the body's rate "
        "of lean. All others are low.",
        ours=f"The ball's velocities go with the rates of lean, as (6, 9) with {over_runs(x_phi)} and (7, 8) with "
        f"{over_runs(y_theta)}; the thesis's pair (7, 9) has {over_runs(named)} (mistake 13). Of all other cells the "
        f"largest is {others[0][1]} with {over_runs([size for size, _ in others])}: on board, a place is the sum of "
        "velocities.",
        checks=(
            Check.over(
                "the ball's velocity goes with the body's rate of lean",
                "the smaller of (6, 9) and (7, 8), its size",
                weaker,
                lowest=clear,
            ),
            Check.over("7 and 9 go together", "their correlation", named, lowest=clear),
            Check.over("6 and 9 go oppositely", "their correlation", x_phi, highest=-clear),
            Check.over("all others are low", "the largest other", [size for size, _ in others], highest=0.5),
        ),
        figure=lambda: correlation_figure(
            symbols(found[0].labels), found[0].matrix, marked=found[0].significant
        ),
    )


#: as drawn over time
_STATES = ("x", "y", "theta", "phi", "psi", "psi_dot")


def _shown(logs: Mapping[str, Log]) -> list[Shown]:
    looks = {
        "measured": ("measured", MEASURED),
        "friction": ("model with friction", WITH_FRICTION),
        "thesis": (BASIC_LABELS["thesis"], THESIS_EQUATIONS),
        "exact": (BASIC_LABELS["exact"], WITHOUT_FRICTION),
    }
    return [
        Shown(label=label, log=logs[name], line=line) for name, (label, line) in looks.items() if name in logs
    ]


def _whole(model: int) -> Ratios:
    return lambda one: one.whole[model] / one.whole[0]


def _restarted(model: int) -> Ratios:
    return lambda one: one.restarted[model] / one.restarted[0]


def _opened(pair: int) -> Ratios:
    return lambda one: one.open_loop[pair, 1] / one.open_loop[pair, 0]


def _over(found: Sequence[Validated], ratios: Ratios, name: str) -> list[float]:
    place = STATE_NAMES.index(name)
    return [float(ratios(one)[place]) for one in found]


def _shaking(bench: Bench, number: int) -> tuple[float, float]:
    """Return how much more the measured and the true lean move at high frequency than the model's with friction."""
    one, h = bench.validations[number], bench.robot.sensors.sample_time
    true = bench.uncompensated[number].truth().states
    modelled, shaken, truly = (
        rms(above(states[:, 2:4], h, _FAST)) for states in (one.runs["friction"].states, one.log.states, true)
    )
    return shaken / modelled, truly / modelled


def _largest_other(found: Correlations) -> tuple[float, str]:
    """Return the largest size of a cell off the diagonal but for velocity with rate of lean, and which it is."""
    sizes = np.abs(np.nan_to_num(found.matrix.copy()))
    np.fill_diagonal(sizes, 0.0)
    for i, j in ((5, 8), (6, 7), (5, 7), (6, 8)):
        sizes[i, j] = sizes[j, i] = 0.0
    i, j = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
    return float(sizes[i, j]), f"({i + 1}, {j + 1})"


def _better(found: Sequence[Validated], ratios: Ratios) -> str:
    """Return in how many states friction lowers the error, and in how many that is sure."""
    table = np.array([ratios(one) for one in found])
    sure = sum(median_with_interval(column).low > 1.0 for column in table.T.tolist())
    lower = int((np.median(table, axis=0) > 1.0).sum())
    return (
        f"friction lowers the error in {lower} of {table.shape[1]} states by the median of {len(found)} runs, in "
        f"{sure} by the whole interval"
    )


def _table_checks(found: Sequence[Validated], ratios: Ratios) -> tuple[Check, ...]:
    return tuple(
        Check.over(
            f"the error of {name} is smaller with friction",
            "error without friction over that with",
            _over(found, ratios, name),
            lowest=1.0,
        )
        for name in STATE_NAMES
    )


def _table(printed: Sequence[Sequence[float]], found: Sequence[Validated], ours: dict[str, Ratios]) -> Rows:
    return Rows(
        headings=("state", "thesis: with friction", "without", "ratio", *(f"ours: {name}" for name in ours)),
        rows=tuple(
            (
                name,
                f"{printed[0][i]:.4f}",
                f"{printed[1][i]:.4f}",
                f"{printed[1][i] / printed[0][i]:.2f}",
                *(over_runs(_over(found, ratios, name)) for ratios in ours.values()),
            )
            for i, name in enumerate(STATE_NAMES)
        ),
    )

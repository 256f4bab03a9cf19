"""How well identification's intervals predict the estimate from another log: twins with all faults, two logs each.

.venv/bin/python -m campaigns.evidence between_logs effective
.venv/bin/python -m campaigns.between_logs prior

Each robot is the nominal twin with every fault of a scenario at once, of random sizes. Its two logs differ in the
reference and in all that is random. Each log of a pair predicts what the other one gives, by two intervals: the one
that identification states, and that for another log. Both have the prior that ships, which is fitted to `TRAINING`, on
which the statistics were developed too; the robots judged are others. Logs and fits are kept in build/between_logs, so
that an interrupted campaign continues; delete the folder after a change of the measurement.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from ballbot.files import write_text
from ballbot.fitting.between_logs import LogEstimates, log_evidence
from ballbot.fitting.fit import fit
from ballbot.fitting.intervals import HALF_WIDTH, Uncertainty
from ballbot.fitting.run import Run, Threads
from ballbot.identification import identify
from ballbot.identification.identify import IdentificationOptions, estimated_parameters, prepare
from ballbot.identification.quantities import FRICTION, Bounds, Coordinates, Layout
from ballbot.identification.variation import PRIOR_FILE, Priors, scaled_units, shipped_priors, widened
from ballbot.log import Log
from ballbot.mechanics.friction import wheel_friction
from ballbot.robot.components import scaled_friction
from ballbot.simulation.imperfections import Roughness, Supply
from ballbot.simulation.sensors import SensorFaults
from ballbot.twin import Scenario
from ballbot.twin.faults import Compliance, CurrentLoop, LoadDependence, Payload, Softness, Timing
from campaigns.coverage import BEGIN
from campaigns.section import Section, kept, share_words
from campaigns.twin_logs import NOMINAL, ROBOT, asymmetric, twin_log

#: the folder of what is finished, within build
KEPT = "between_logs"
DURATION = 24.0  # [s] of each log of a pair
STEP = 2.5e-3  # [s], inner step of the fits
#: the prior that ships is fitted to these; the statistics were developed on the first eight and the last six
TRAINING = (*range(1000, 1032), *range(6))
#: 20 s of computing each
UNSEEN = range(1032, 1080)
#: at least so much of a log is recorded before the robot falls, or another seed is taken
_LEAST = 0.9
#: share of the other log's estimates that either interval holds at least; the stated one is narrower, for the mean
_HELD = 0.85
_SEEDS = 5


def drawn(seed: int) -> Scenario:
    """Return the twin of a seed, with all faults."""
    random = np.random.default_rng([seed, 61])
    # size of each fault: U(0.2, 1) of the largest
    size = dict(zip(_FAULTS, random.uniform(0.2, 1.0, len(_FAULTS)).tolist(), strict=True))
    # dry and viscous friction: U(0.6, 1.5) of the nominal one, each wheel U(0.85, 1.15) of that; rolling: U(0.5, 2)
    wheels = float(random.uniform(0.6, 1.5)) * random.uniform(0.85, 1.15, 3)
    rolling = float(random.uniform(0.5, 2.0))
    uphill, beside = random.uniform(0.0, 2.0 * np.pi, 2).tolist()
    tilt, rollers = np.radians(0.5 * size["tilt"]), NOMINAL.rollers
    return replace(
        NOMINAL,
        name=f"all faults {seed}",
        friction=asymmetric(
            scaled_friction(NOMINAL.friction, wheels.tolist(), rolling_factor=rolling),
            float(random.uniform(-0.15, 0.15)),
        ),
        backlash=float(np.radians(random.uniform(0.3, 1.5))),
        rollers=replace(
            rollers, row_spacing=rollers.row_spacing + 0.5 * size["rows"] * (0.022 - rollers.row_spacing)
        ),
        roller_grip=1.0 - 0.5 * size["roller grip"],
        floor_grip=1.0 - 0.5 * size["floor grip"],
        floor_tilt=(float(tilt * np.cos(uphill)), float(tilt * np.sin(uphill))),
        load_dependence=LoadDependence(fraction=0.6 * size["load"]),
        roughness=Roughness(height=2e-4 * size["bumps"], wavelength=0.1, seed=int(random.integers(1000))),
        softness=Softness(stiffness=3e4 / size["softness"], damping=200.0),
        compliance=Compliance(frequency=60.0 - 15.0 * size["compliance"], damping_ratio=0.1),
        current_loop=CurrentLoop(bandwidth=60.0 - 40.0 * size["current"]),
        supply=Supply(internal_resistance=0.5 * size["supply"]),
        payload=Payload(
            mass=0.5 * size["payload"],
            position=(0.05 * float(np.cos(beside)), 0.05 * float(np.sin(beside)), 0.6),
        ),
        sensor_faults=SensorFaults(
            gyro_bias=0.005 * size["gyro"],
            gyro_bias_walk=5e-4 * size["gyro"],
            lean_error=0.004 * size["lean"],
            lean_error_time=10.0,
            latency=0.005 * int(random.integers(2)),
        ),
        timing=Timing(delay=int(random.integers(3))),
    )


_FAULTS = (
    *("tilt", "rows", "roller grip", "floor grip", "load", "bumps", "softness"),
    *("compliance", "current", "supply", "payload", "gyro", "lean"),
)


def references_of(seed: int) -> list[str]:
    """Return the references of a robot's two logs."""
    return np.random.default_rng([seed, 62]).choice(["square", "figure_eight"], 2).tolist()


def pair_log(seed: int, which: int) -> Log:
    """Return a log of the twin of a seed, by its own sensors, from file if it is there."""

    def make() -> Log:
        for attempt in range(_SEEDS):
            run_seed = 10 * seed + which + 100_000 * attempt
            log = twin_log(references_of(seed)[which], duration=DURATION, seed=run_seed, scenario=drawn(seed))
            if log.t[-1] > _LEAST * DURATION:
                return log
        raise RuntimeError(f"The twin {seed} falls with {_SEEDS} seeds.")

    return kept(KEPT, f"{seed:04d}_{which}", make)


def nominal_log(seed: int, scenario: Scenario = NOMINAL) -> Log:
    """Return a log of the nominal twin around the square, or of one with a fault switched."""

    name = f"{scenario.name.replace(' ', '_')}_{DURATION:.0f}_{seed:02d}"
    return kept(KEPT, name, lambda: twin_log("square", duration=DURATION, seed=seed, scenario=scenario))


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedLog:
    """The fit of one log."""

    coordinates: Coordinates
    values: NDArray[np.float64]  #: (p,), SI units; NaN if a parameter has no influence
    within: Uncertainty  #: by its own windows, with errors that a discrepancy has widened
    by_log: LogEstimates


def fit_of(log: Log, name: str, *, law: str = "stribeck") -> FittedLog:
    """Return a log's fit, in one thread, from file if it is there.

    As `identify` does, without its evolution, from a start far from the truth, and without profiles.
    """

    def make() -> FittedLog:
        coordinates = estimated_parameters(ROBOT, free=("friction",), law=law, bounds=Bounds())
        options, run = (
            IdentificationOptions(step=STEP, most_profiles=0),
            Run(seed=0, executor=Threads(count=1)),
        )
        prepared = prepare(ROBOT, coordinates, [log], window=0.25, options=options, run=run)
        begin = coordinates.scaled(np.where(coordinates.free, BEGIN, coordinates.nominal))
        estimate = fit(
            prepared.experiment,
            begin,
            refused=prepared.refused,
            groups=prepared.groups,
            options=options,
            run=run,
        )
        return FittedLog(
            coordinates=coordinates,
            values=np.where(estimate.unknown, np.nan, estimate.values),
            within=estimate.uncertainty,
            by_log=estimate.by_log,
        )

    return kept(KEPT, f"fit_{name}_{law}", make)


def pairs(seeds: Sequence[int]) -> Iterator[tuple[FittedLog, FittedLog]]:
    """Yield the fits of each twin's two logs."""
    for seed in seeds:
        first, second = (fit_of(pair_log(seed, which), f"{seed:04d}_{which}") for which in (0, 1))
        yield first, second
        print(f"pair {seed}", file=sys.stderr, flush=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotLogs:
    """Estimates of p parameters from the logs of one robot, k of 2 or more, in the units that sizes are shares of."""

    estimates: NDArray[np.float64]  #: (k, p)
    covariances: NDArray[np.float64]  #: (k, p, p), within each log
    groups: NDArray[np.int64]  #: (p,), parameters of one number have the same size


#: least degrees of a prior: two or fewer have no finite mean; no more than robots that it is fitted to
_LEAST_DEGREES = 3.0
#: of the prior of the sizes that is fitted with: they are within a factor of ten about this share
_SIZE, _SIZE_FACTOR = 0.1, 10.0


def fit_prior(robots: Sequence[RobotLogs], *, groups: int) -> tuple[NDArray[np.float64], float]:
    """Return the sizes of D by group (g,) and the degrees of tau^2 under which the robots' logs are likeliest."""
    limits = np.log((_LEAST_DEGREES, max(len(robots), _LEAST_DEGREES)))

    def prior_of(numbers: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        return np.exp(numbers[:groups]), float(np.exp(np.clip(numbers[groups], *limits)))

    def loss(numbers: NDArray[np.float64]) -> float:
        sizes, degrees = prior_of(numbers)
        known = 0.5 * np.sum((np.log(sizes / _SIZE) / (np.log(_SIZE_FACTOR) / HALF_WIDTH)) ** 2)
        return float(known) - sum(
            log_evidence(
                robot.estimates, robot.covariances, np.diag(sizes[robot.groups] ** 2), degrees=degrees
            )
            for robot in robots
        )

    start = np.array([*np.full(groups, np.log(_SIZE)), np.log(6.0)])
    near = minimize(loss, start, method="Powell", options={"xtol": 1e-2, "ftol": 1e-4})
    return prior_of(minimize(loss, near.x, method="Nelder-Mead", options={"xatol": 1e-2, "fatol": 1e-2}).x)


def fitted_priors(training: Sequence[tuple[FittedLog, FittedLog]]) -> Priors:
    """Return the priors by quantity, from the parameters that both logs of a robot gave a standard error."""
    robots = []
    for both in training:
        coordinates = both[0].coordinates
        points, covariances = (
            np.concatenate([getattr(fit.by_log, name) for fit in both]) for name in ("points", "covariances")
        )
        columns = np.flatnonzero(np.isfinite(covariances.diagonal(axis1=1, axis2=2)).all(axis=0))
        units = scaled_units(coordinates, np.mean([_known(fit) for fit in both], axis=0))
        robots.append(
            RobotLogs(
                estimates=points[:, columns] / units[columns],
                covariances=covariances[:, columns[:, None], columns]
                / np.outer(units[columns], units[columns]),
                groups=np.array([FRICTION.index(coordinates.names[i]) for i in columns]),
            )
        )
    sizes, degrees = fit_prior(robots, groups=len(FRICTION))
    return Priors(
        sizes=dict(zip(FRICTION, sizes.tolist(), strict=True)), degrees=degrees, robots=len(training)
    )


def _known(fit: FittedLog) -> NDArray[np.float64]:
    """Return a fit's values (p,), those of the description for what has no influence."""
    return np.where(np.isfinite(fit.values), fit.values, fit.coordinates.nominal)


#: the intervals that are judged: the one that identification states, and that for the estimate from another log
KINDS = ("stated", "another log")


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """One parameter in one pair: the estimates from the first and the second log, and the first one's intervals."""

    label: str
    first: float
    second: float
    ends: NDArray[np.float64]  #: (2, 2), of `KINDS`, within the bounds of the search

    @property
    def held(self) -> NDArray[np.bool_]:
        """Which intervals hold the second log's estimate (2,)."""
        return (self.ends[:, 0] <= self.second) & (self.second <= self.ends[:, 1])


def judge(both: tuple[FittedLog, FittedLog], priors: Priors) -> Iterator[Judged]:
    """Yield each parameter that both logs give a number."""
    first, second = both
    coordinates = first.coordinates
    stated, varied = widened(coordinates, first.within, first.by_log, priors=priors)
    kinds = (stated.intervals, varied.predictions)
    for index, label in enumerate(coordinates.labels):
        numbers = (float(first.values[index]), float(second.values[index]))
        if label in first.within.intervals and np.isfinite(numbers).all():
            ends = np.array([(kind[label].lower, kind[label].upper) for kind in kinds])
            within = np.clip(ends, coordinates.lower[index], coordinates.upper[index])
            yield Judged(label=label, first=numbers[0], second=numbers[1], ends=within)


def coverage_row(name: str, judged: Sequence[Judged]) -> list[str]:
    """Return how many estimates the intervals held, and the median of their widths over the spread of repeated logs.

    That is twice 1.96 of the standard deviation that the differences of the pairs show, each parameter's own.
    """
    held = np.array([case.held for case in judged]).sum(axis=0)
    relative = []
    for label in dict.fromkeys(case.label for case in judged):
        mine = [case for case in judged if case.label == label]
        spread = 2.0 * HALF_WIDTH * np.sqrt(np.mean([0.5 * (case.first - case.second) ** 2 for case in mine]))
        relative += [
            np.diff(case.ends, axis=1)[:, 0] / spread if spread > 0.0 else [np.inf] * 2 for case in mine
        ]
    cells = []
    for count, width in zip(held.tolist(), np.median(relative, axis=0).tolist(), strict=True):
        cells += [f"{count} of {len(judged)}, {share_words(count, len(judged))}", f"{width:.2f}"]
    return [name, *cells]


COLUMNS = ("", *(f"{kind}: {what}" for kind in KINDS for what in ("held", "width")))


def campaign() -> Section:
    """Judge the priors that ship and return the section of docs/generated/evidence.md."""
    priors = shipped_priors()
    judged: list[Judged] = []
    for first, second in pairs(UNSEEN):
        judged += [*judge((first, second), priors), *judge((second, first), priors)]
    nominal = [fit_of(nominal_log(seed), f"nominal_24_{seed:02d}") for seed in SEEDS]
    of_nominal = [case for both in permutations(nominal, 2) for case in judge(both, priors)]
    return Section(
        title="Intervals for the estimate from another log",
        before=f"{len(UNSEEN)} twins with all faults at once, of random sizes, each with two logs of {DURATION:g} s; "
        f"nothing was developed on them or fitted to them. Two 95 % intervals from one log are compared with the "
        "estimate from the other, both ways: the one that identification states, and that for another log. Both have "
        f"the variation between logs of {priors.robots} other twins. In "
        "brackets the 95 % interval of the share, as if all were independent. Width: median, over the spread of the "
        f"estimates from repeated logs. Below, all pairs of {len(SEEDS)} logs of the nominal twin.",
        columns=list(COLUMNS),
        rows=[
            *(
                coverage_row(name, [case for case in judged if case.label.rstrip("123") == name])
                for name in _SYMBOLS
            ),
            coverage_row("all", judged),
            coverage_row("nominal twin, all", of_nominal),
        ],
    )


_SYMBOLS = ("b", "c", "s", "v_s", "delta", "C_rr")


SEEDS = range(1, 11)


DRY_SPEED = 0.5  # [rad/s]
#: of the twelve parameters
LAYOUT = Layout(wheel_count=3)


def _dry(values: NDArray[np.float64]) -> NDArray[np.float64]:
    friction = LAYOUT.robot_of(ROBOT, values).friction
    return wheel_friction(np.full(3, DRY_SPEED), replace(friction, viscous=(0.0,) * 3))


#: the nominal twin with one fault switched off, or one more
SWITCHED = {
    "nominal": NOMINAL,
    "no play": replace(NOMINAL, name="no play", backlash=0.0),
    "point contact": replace(NOMINAL, name="point contact", wheel_contact="point"),
    "point contact, no play": replace(NOMINAL, name="point no play", wheel_contact="point", backlash=0.0),
    "no rolling friction": replace(
        NOMINAL, name="no rolling", friction=replace(NOMINAL.friction, rolling=0.0)
    ),
    "no torque noise": replace(NOMINAL, name="no torque noise", torque_noise=0.0),
    "a ball that gives": replace(NOMINAL, name="soft", softness=Softness(stiffness=3e4, damping=200.0)),
    "rollers' grip 0.4": replace(NOMINAL, name="slippery", roller_grip=0.4),
    "motors that lag by 5 ms": replace(NOMINAL, name="lag", current_loop=CurrentLoop(bandwidth=32.0)),
    "pivoting at 2 mm": replace(NOMINAL, name="pivots", pivoting=0.002),
}
_SWITCHED_SEEDS = (1, 2)


def effective() -> Section:
    """Identify twins with single faults switched and return the section of docs/generated/evidence.md."""
    rows = [["set", *_means(LAYOUT.nominal(ROBOT.replace(friction=NOMINAL.friction))), ""]]
    for name, scenario in SWITCHED.items():
        found = identify(ROBOT, [nominal_log(seed, scenario) for seed in _SWITCHED_SEEDS], seed=0)
        softness = found.robot.friction.roller_softness
        rows.append([name, *_means(found.values), f"{softness:.2g}" if softness else ""])
    return Section(
        title="What the identified parameters represent",
        before="The nominal twin with single faults switched off or on, identified from balancing: means over the "
        f"wheels, from {len(_SWITCHED_SEEDS)} logs of {DURATION:g} s. A parameter that a fault moves is effective: it "
        "stands for that fault too. The last column is the contacts' softness where the rollers were found.",
        columns=["", "b", "c", "s", "v_s", "delta", "C_rr", "dry at 0.5 rad/s", "softness"],
        rows=rows,
    )


def _means(values: NDArray[np.float64]) -> list[str]:
    parts = [*(values[3 * k : 3 * k + 3].mean() for k in range(3)), *values[9:12], _dry(values).mean()]
    return [f"{part:.3g}" for part in parts]


def write_prior() -> None:
    """Fit the priors to the training robots and write the table that ships."""
    training = list(pairs(TRAINING))
    write_text(PRIOR_FILE, _prior_text(calibrated(fitted_priors(training), training)))


def calibrated(priors: Priors, training: Sequence[tuple[FittedLog, FittedLog]]) -> Priors:
    """Return priors times the least quarter step with which both intervals hold `_HELD` of the training estimates.

    With the sizes as fitted, the stated 95 % intervals hold 82 % of them.
    """
    for factor in np.arange(1.0, 4.0, 0.25).tolist():
        wider = replace(priors, sizes={name: factor * size for name, size in priors.sizes.items()})
        judged = [case for both in training for pair in (both, both[::-1]) for case in judge(pair, wider)]
        if np.mean([case.held for case in judged], axis=0).min() >= _HELD:
            return wider
    raise RuntimeError("The priors that the training robots give hold too few of their own estimates.")


def _prior_text(priors: Priors) -> str:
    head = PRIOR_FILE.read_text(encoding="utf-8").split("robots =")[0]
    sizes = "".join(f"{name} = {size:#.3g}\n" for name, size in priors.sizes.items())
    return f"{head}robots = {priors.robots}\ndegrees = {priors.degrees:#.3g}\n\n[sizes]\n{sizes}"


if __name__ == "__main__":
    if sys.argv[1:] != ["prior"]:
        raise SystemExit("python -m campaigns.between_logs prior")
    write_prior()

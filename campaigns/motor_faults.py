"""Faults of a motor within a log: how often they are named, by length and size, and how often a sound log gets one.

.venv/bin/python -m campaigns.evidence motor_faults

A motor that gives less torque than its command, or none, fails in the plant, so that the robot feels it. A torque of
the opposite sign and two motors exchanged are faults of a log's columns, made in sound ones. The limits of
`ballbot.log.checks.motor_faults` were chosen on 449 sound logs and 60 of failing motors of other seeds. Among them are
those of two earlier judgements, which gave 2 of 124 and 1 of 336 sound logs an error: robots that stood, held by the
friction of wheels and ball, which show nothing since. The seeds below were drawn after that, and this file committed,
before the first of these runs. Finished runs are kept in build/motor_faults and are not repeated.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from ballbot.control.controller import Controller
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.references import Reference, circle, figure_eight, hold, square
from ballbot.log import Log
from ballbot.log.checks.physics import examine
from ballbot.report.style import LOOKS, MARKS, one_panel
from ballbot.robot import Robot
from ballbot.robot.components import scaled_friction
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Push
from ballbot.simulation.plant import Plant
from ballbot.simulation.run import initial_state_of, simulate
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin import Scenario, Twin
from ballbot.twin.faults import Carpet, Payload
from ballbot.twin.imperfections import changes_of, imperfections_of, true_model
from campaigns.mapping_recordings import NOMINAL_MASS, robot_named
from campaigns.section import Section, finished, share_words, write_picture
from tests.support.failing_motor import COLUMNS, FailingMotor, Fault

#: 400 sound logs, of the compiled loop and of the twin, and logs with a motor that fails, likewise
SOUND, SOUND_TWIN = range(1850500, 1850870), range(288600, 288630)
FAILING, FAILING_TWIN = range(521600, 521792), range(7154100, 7154112)
#: robots, and those that the precise controller is for
ROBOTS = ("alten", "kugle", "rezero", "rob311", "cmu", "barrel", "kettle", "cart_four_wheels")
PRECISE = ("alten", "kugle", "rezero", "barrel", "kettle")
#: in turn by seed: 28 of 40 have play, slip or a payload
WORLDS = (
    "nominal",
    "play",
    "slip",
    "payload",
    "carpet",
    "play",
    "slip",
    "payload",
    "pushes",
    "play and payload",
)
COURSES = ("hold", "square", "circle", "figure_eight")
#: of faults [s]; the last is until the end of the log
LENGTHS = (0.5, 1.0, 2.0, 5.0, 10.0, np.inf)
#: parts of its torque that a failing motor gives
FACTORS = (0.0, 0.25, 0.5, 0.75)
#: a fault's begin and end are right within this [s]
TOLERANCE = 1.0


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What the checks say of a log."""

    world: str
    twin: bool
    fault: Fault | None
    named: bool  #: any motor, any kind
    right: bool  #: motor and kind
    in_time: bool  #: begin and end, too
    fallen: bool


def _scenario(robot: Robot, world: str, random: np.random.Generator) -> Scenario:
    base, heavier = Scenario.nominal(robot), robot.body.mass / NOMINAL_MASS
    scenario = replace(
        base, friction=scaled_friction(base.friction, heavier), torque_noise=heavier * base.torque_noise
    )
    if "play" in world:
        scenario = replace(scenario, backlash=float(np.radians(random.uniform(1.5, 3.0))))
    if "payload" in world:
        x, y, share = random.uniform([-0.02, -0.02, 0.03], [0.02, 0.02, 0.1])
        z, put_on = random.uniform(0.8, 1.6) * robot.body.center_of_mass, float(random.choice([0.0, 8.0]))
        payload = Payload(mass=share * robot.body.mass, position=(x, y, z), put_on=put_on)
        scenario = replace(scenario, payload=payload)
    if world == "slip":
        scenario = replace(scenario, roller_grip=random.uniform(0.25, 0.6))
    if world == "carpet":
        scenario = replace(scenario, carpet=Carpet(rolling=0.02, pivoting=0.04, begins=8.0))
    if world == "pushes":
        pushes = []
        for t in np.sort(random.uniform(4.0, 18.0, 3)):
            force = random.uniform(30.0, 80.0) * heavier * np.exp(1j * random.uniform(0.0, 2.0 * np.pi))
            duration = random.uniform(0.1, 0.3)
            pushes.append(Push(time=t, duration=duration, force=(force.real, force.imag, 0.0), height=0.3))
        scenario = replace(scenario, pushes=tuple(pushes))
    return scenario


def _course(name: str, random: np.random.Generator) -> Reference:
    size, period = random.uniform(0.3, 0.9), random.uniform(16.0, 32.0)
    match name:
        case "square":
            return square(side=0.7 * size, period=period)
        case "circle":
            return circle(radius=0.5 * size, period=period)
        case "figure_eight":
            return figure_eight(length=size, width=0.5 * size, period=period)
    return hold()


def _controller(name: str, random: np.random.Generator) -> Controller:
    robot = robot_named(name)
    return (precise_controller if name in PRECISE and random.random() < 0.5 else nominal_controller)(robot)


def recorded(seed: int, *, twin: bool, failing: bool) -> tuple[Log, Robot, str, Fault | None]:
    """Return the log of a drawn run by the robot's own sensors, its robot, its world and the fault of its motor."""
    random = np.random.default_rng(seed)
    cells = [(factor, length) for factor in FACTORS for length in LENGTHS]
    name, turn = str(random.choice(ROBOTS)), seed // len(cells) if failing else seed
    world = WORLDS[turn % len(WORLDS)]
    robot = robot_named(name)
    scenario, course = _scenario(robot, world, random), _course(str(random.choice(COURSES)), random)
    controller, duration, fault = _controller(name, random), random.uniform(20.0, 48.0), None
    model = true_model(robot, scenario)
    imperfections = replace(
        imperfections_of(scenario, known=robot), later=changes_of(robot, scenario), seed=seed
    )
    if not failing and not twin:  # a hundred times as fast as one sample at a time
        batch = simulate_batch(
            model, controller, course, duration=duration, initial_states=initial_state_of(seed),
            imperfections=imperfections, threads=1,
        )  # fmt: skip
        return batch.log(0).without_truth(), robot, world, None
    plant: Plant = Twin(robot, scenario) if twin else SensedPlant(model, imperfections)
    if failing:
        factor, length = cells[seed % len(cells)]
        motor = int(random.integers(robot.wheel_count))
        fault = Fault(kind=f"{factor:g}", motors=(motor,), start=random.uniform(6.0, 12.0), length=length)
        plant, duration = FailingMotor(plant, fault), fault.start + min(length, 10.0) + 6.0
    log = simulate(plant, controller, course, duration=duration, seed=seed)
    return log.without_truth(), robot, world, fault


def column_fault(log: Log, robot: Robot, kind: str, random: np.random.Generator) -> tuple[Log, Fault]:
    """Return a log with a fault of its columns."""
    i, j = random.choice(robot.wheel_count, 2, replace=False).tolist()
    length, start = float(random.choice(LENGTHS)), random.uniform(3.0, max(log.t[-1] - 11.0, 4.0))
    rows = (log.t >= start) & (log.t < start + length)
    motors = (i,) if kind == COLUMNS[0] else (min(i, j), max(i, j))
    fault = Fault(kind=kind, motors=motors, start=start, length=length)
    a, b = f"{i + 1}", f"{j + 1}"
    if kind == COLUMNS[0]:
        return log.with_columns({f"u{a}": np.where(rows, -log[f"u{a}"], log[f"u{a}"])}), fault
    names = ["u{}", "wheel{}", "wheel{}_dot"][: 3 if kind == COLUMNS[2] else 1]
    pairs = [(one.format(a), one.format(b)) for one in names] + [
        (one.format(b), one.format(a)) for one in names
    ]
    return log.with_columns({to: np.where(rows, log[of], log[to]) for to, of in pairs}), fault


def verdict(log: Log, robot: Robot, *, world: str, twin: bool, fault: Fault | None) -> Verdict:
    """Return what the checks say of a log."""
    # those of a whole log have no time
    named = [item for item in examine(log, robot).findings if item.where.time is not None]
    right = in_time = False
    if named and fault is not None:
        found, last = named[0], float(log.t[-1])
        columns = tuple(f"u{i + 1}" for i in fault.motors)
        right = found.code in fault.codes and found.where.columns == columns
        until = re.search(r" (?:to|until) ([\d.]+) s", found.text)
        begin, end = found.where.time or 0.0, float(until[1]) if until else last
        off = max(abs(begin - fault.start), abs(end - min(fault.start + fault.length, last)))
        in_time = right and off <= TOLERANCE
    return Verdict(
        world=world, twin=twin, fault=fault, named=bool(named), right=right, in_time=in_time,
        fallen=log.ended is not None,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Run:
    """A run to record and check."""

    seed: int
    twin: bool
    failing: bool


def checked(run: Run) -> list[Verdict]:
    """Return the verdicts on a run: on the failing motor, or on the sound log and on faults of its columns."""
    log, robot, world, fault = recorded(run.seed, twin=run.twin, failing=run.failing)
    verdicts = [verdict(log, robot, world=world, twin=run.twin, fault=fault)]
    if not run.failing:
        random = np.random.default_rng([run.seed, 1])
        for kind in COLUMNS:
            changed, fault = column_fault(log, robot, kind, random)
            verdicts.append(verdict(changed, robot, world=world, twin=run.twin, fault=fault))
    return verdicts


def runs() -> dict[str, Run]:
    """Return every run of the campaign by name."""
    groups = {
        "sound": (SOUND, False, False), "sound_twin": (SOUND_TWIN, True, False),
        "failing": (FAILING, False, True), "failing_twin": (FAILING_TWIN, True, True),
    }  # fmt: skip
    return {
        f"{name}_{seed}": Run(seed=seed, twin=twin, failing=failing)
        for name, (seeds, twin, failing) in groups.items()
        for seed in seeds
    }


def _names() -> list[str]:
    """Return the kinds of fault as rows of the table are called, in order."""
    return [*(f"{100 * (1.0 - factor):.0f} % of the torque lost" for factor in FACTORS), *COLUMNS]


def campaign() -> Section:
    """Make the missing runs and return the section of docs/generated/evidence.md."""
    verdicts = [one for of_run in finished("motor_faults", checked, runs()).values() for one in of_run]
    sound = [one for one in verdicts if one.fault is None]
    faulty = [(one, one.fault) for one in verdicts if one.fault is not None]
    kinds = dict(zip(_names(), [*(f"{factor:g}" for factor in FACTORS), *COLUMNS], strict=True))
    cells = {
        name: [
            [one for one, fault in faulty if (fault.kind, fault.length) == (kind, length)]
            for length in LENGTHS
        ]
        for name, kind in kinds.items()
    }
    named = [one for one, _ in faulty if one.named]
    right = [one for one in named if one.right]
    special = [one for one in sound if any(word in one.world for word in ("play", "slip", "payload"))]
    alarms = sum(one.named for one in sound)
    figure = write_picture("motor_faults", lambda: power_figure(cells))
    rows = [
        [
            name,
            *(f"{sum(v.right for v in cell)} of {len(cell)} – {sum(v.in_time for v in cell)}" for cell in of),
        ]
        for name, of in cells.items()
    ]
    return Section(
        title="Faults of a motor within a log",
        before="How many faults `check-log` names with the right motor and kind, and behind the dash how many of "
        f"these have begin and end right to {TOLERANCE:g} s, by their length. Motors that fail do so in the plant, so "
        f"that the robot feels it, and many logs end in a fall: {len(FAILING)} logs of the compiled loop, "
        f"{len(FAILING_TWIN)} of the twin. The opposite sign and the exchange are made in the columns of the "
        f"{len(SOUND)} sound logs of the loop and {len(SOUND_TWIN)} of the twin, with lengths drawn. Robots, "
        "controllers (nominal and precise), courses (also a hold, in which friction holds the wheels and little shows),"
        " play, slip, payload, carpet and pushes are drawn; the limits were chosen on other seeds.",
        columns=["fault", *(f"{length:g} s" for length in LENGTHS[:-1]), "until the end"],
        rows=rows,
        after=f"Of {len(named)} faults that are named, {len(right)} have the right motor and kind, and "
        f"{sum(one.in_time for one in right)} the right times, too. Of {len(sound)} sound logs "
        f"({len(special)} with play, slip or a payload, {sum(one.fallen for one in sound)} that end in a fall) "
        f"{alarms} get such an error: {share_words(alarms, len(sound))}."
        f"\n\n![Share of faults named by their length]({figure})",
    )


def power_figure(cells: Mapping[str, Sequence[Sequence[Verdict]]]) -> Figure:
    """Return the shares of faults whose motor and kind are named right, by their length."""
    figure, axes = one_panel("length of the fault", "motor and kind right [%]")
    for (name, of), mark, look in zip(cells.items(), (*MARKS, "*"), LOOKS.values(), strict=False):
        shares = [100.0 * sum(one.right for one in cell) / max(len(cell), 1) for cell in of]
        axes.plot(range(len(LENGTHS)), shares, label=name, marker=mark, markersize=4, **look)
    axes.set_xticks(range(len(LENGTHS)), [*(f"{length:g} s" for length in LENGTHS[:-1]), "to the end"])
    axes.set_ylim(0.0, 100.0)
    axes.legend(loc="upper left", fontsize=7.5)
    return figure

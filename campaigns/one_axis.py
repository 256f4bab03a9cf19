"""Identify one axis: public records, compared with what is published, and simulated machines.

.venv/bin/python -m campaigns.evidence one_axis          with BALLBOT_DATA=DIR
.venv/bin/python -m campaigns.evidence axis_joints       with BALLBOT_DATA=DIR
.venv/bin/python -m campaigns.evidence axis_machines

The record DATA_EMPS.mat is the training record of A. Janot, M. Gautier, M. Brunot, Data set and reference models of
EMPS, 2019. It is not part of Ballbot: put it into the folder emps of DIR. docs/axis.md says where it is, and how the
records of joints are made, which stand in the folder axes.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
import scipy

from ballbot.errors import InputError
from ballbot.findings import texts
from ballbot.identification.axis import (
    AxisIdentification,
    AxisOptions,
    AxisRecord,
    identify_axis,
)
from ballbot.identification.axis.checks import record_findings
from ballbot.identification.axis.identify import AxisEstimate
from ballbot.identification.axis.model import LAWS
from ballbot.identification.axis.record import AxisColumns, read_axis_record
from ballbot.rounding import DASH
from campaigns.section import DataMissingError, Section, data_folder, public_file, share_words
from tests.support.axis_joints import JOINTS, Joint
from tests.support.axis_machines import Drive, Logging, Machine, Motion, record_of

#: of the record
SHA_256 = "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e"
SOURCE = (
    "DATA_EMPS.mat of A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, Workshop on Nonlinear "
    f"System Identification Benchmarks, Eindhoven, 2019 (https://www.nonlinearbenchmark.org; SHA-256 {SHA_256})"
)
#: published values and standard deviations
PUBLISHED = {
    "mass": (95.1089, 0.1085),
    "viscous": (203.5034, 1.1460),
    "coulomb": (20.3935, 0.1012),
    "offset": (-3.1648, 0.0444),
}


def emps_record() -> AxisRecord:
    """Return the benchmark's training record; DataMissingError if it is not there."""
    path = public_file("emps/DATA_EMPS.mat", sha256=SHA_256, see="docs/axis.md")
    return read_axis_record(path, AxisColumns(position="qm", force="vir", force_scale="gtau"))


def campaign() -> Section:
    """Identify the axis and return the section of docs/generated/evidence.md."""
    record = emps_record()
    result = identify_axis(record)
    published = ["published (inverse model)", *(f"{v:.4f} ± {s:.4f}" for v, s in PUBLISHED.values()), ""]
    return Section(
        title="One axis: the EMPS benchmark",
        before=f"The training record {SOURCE}: 24.84 s at 1 kHz of an electro-mechanical positioning system, its "
        "position and its motor's voltage. In the first row the standard errors treat samples as independent, as "
        "published; below they are clustered in time, and those of the result include what differs between parts and "
        "methods. Open loop: RMS position error over the whole record [mm].",
        columns=["law", "M [kg]", "b [N s/m]", "c [N]", "offset [N]", "open loop"],
        rows=[published, *(_row(name, fit) for name, fit in result.by_law.items())],
        after=_after(result),
    )


def _row(name: str, fit: AxisEstimate) -> list[str]:
    texts = []
    for parameter in PUBLISHED:
        value, error = fit.values.get(parameter, 0.0), fit.standard_errors.get(parameter, 0.0)
        texts.append(f"{value:.4g} ± {error:.2g}" if parameter in fit.values else "")
    return [name, *texts, f"{1e3 * fit.errors[fit.motions[0].record.name].open_loop_rmse:.2f}"]


def _after(result: AxisIdentification) -> str:
    gains = "; ".join(
        f"{name} over {LAWS[name][1]} {100.0 * fit.gain.share:.0f} % "
        f"({100.0 * fit.gain.lower:.0f} to {100.0 * fit.gain.upper:.0f})"
        for name, fit in result.by_law.items()
        if fit.gain
    )
    return (
        f"The windows last {result.window:g} s. Less error on held-out blocks, with 95 % intervals: {gains}. "
        f"{' '.join(texts(result.findings))}"
    )


_JOINT_SOURCES = (
    "Sources: TX40: thanhndv212/figaroh-examples at c0b5c7f0, examples/staubli_TX40 (data, and values in config/"
    "TX40_config.yaml). Panda: marcocognetti/FrankaEmikaPandaDynModel at 24d85ce4, matlab (data/Exciting_Traj/"
    "Trajectory_1, dyn_model_panda/get_FrictionTorque.m). OpenArm: YIZHIXIAOCANGSHU/"
    "Friction-Identification-for-Manipulators at f9157512, results."
)


def joints() -> Section:
    """Identify the joints of public records and return the section of docs/generated/evidence.md."""
    folder = data_folder()
    if not (folder / "axes").is_dir():
        raise DataMissingError(f"it needs {folder / 'axes'}; see docs/axis.md")
    outcomes = {joint.name: _identified(joint.read(folder)) for joint in JOINTS}
    refused = [f"{name}: {why}" for name, why in outcomes.items() if isinstance(why, str)]
    return Section(
        title="One axis: joints of arms",
        before="Each joint from its own record, with no option but its columns. *Published*: by a regression of all "
        "joints' torques together (TX40), a sigmoid of the speed whose level is taken for c (Panda), and a regression "
        "with bounds after a model of the arm (OpenArm, coefficients at their bounds). Ours: with 95 % intervals. "
        "Held-out: RMS torque of the second half of the moving rows (above 0.02 rad/s) by a fit to the first half, "
        "over its standard deviation, torque and position low-passed at 10 Hz; *plain* is a least-squares fit of "
        "inertia, b, c, offset and, if the axis is not vertical, gravity; *free* has any friction over speed (a broken "
        "line of five pieces) in c's place. Units are N m, rad and s.",
        columns=["joint", "b published", "b", "c published", "c", "held-out", "plain", "free", "it lacks"],
        rows=[_joint_row(joint, outcomes[joint.name]) for joint in JOINTS],
        after=f"{_JOINT_SOURCES} Refused: {' '.join(refused)}",
    )


def _joint_row(joint: Joint, found: AxisEstimate | str) -> list[str]:
    values, halves = ({}, {}) if isinstance(found, str) else (found.values, found.half_widths)
    own = [
        f"{values[name]:.3g} ± {halves[name]:.2g}" if name in values else "refused" if not values else "none"
        for name in ("viscous", "coulomb")
    ]
    texts = (
        DASH if np.isnan(share) else f"{share:.3f}" for share in _held_out(joint, joint.read(data_folder()))
    )
    return [joint.name, f"{joint.viscous:g}", own[0], f"{joint.coulomb:g}", own[1], *texts, joint.lacks]


def _identified(record: AxisRecord) -> AxisEstimate | str:
    """Return the estimate as the command makes it, or the sentence with which it refuses the record."""
    try:
        errors = [finding.text for finding in record_findings(record) if finding.severity == "error"]
        return errors[0] if errors else identify_axis(record).best
    except InputError as error:
        return str(error)


def _held_out(joint: Joint, record: AxisRecord) -> tuple[float, float, float]:
    """Return the held-out errors of ours, of the plain fit and of one with free friction, as shares of the torque."""
    h, force, position = record.sample_time, record.force, record.position
    if h < 2e-3:
        numbers = scipy.signal.butter(4, 2.0 * 10.0 * h)
        force, position = (scipy.signal.filtfilt(*numbers, values) for values in (force, position))
    speed = np.gradient(position, h)
    acceleration, size, side = np.gradient(speed, h), np.abs(speed), np.sign(speed)
    moving = np.flatnonzero(size > 0.02)
    first, second = moving[: len(moving) // 2], moving[len(moving) // 2 :]
    columns = [acceleration, speed, np.ones(len(speed))]
    columns += [np.sin(position), np.cos(position)] if joint.gravity else []
    knots = np.quantile(size[first], [0.1, 0.25, 0.5, 0.75])
    free = [side * np.maximum(size - knot, 0.0) for knot in knots]
    errors = []
    for design in (np.column_stack([side, *columns]), np.column_stack([side, *columns, *free])):
        values = np.linalg.lstsq(design[first], force[first], rcond=None)[0]
        errors.append(force - design @ values)
    times = None if record.times is None else record.times[: second[0]]
    half = replace(
        record, force=record.force[: second[0]], position=record.position[: second[0]], times=times
    )
    left = np.full(len(force), np.nan)
    with suppress(InputError):
        axis = identify_axis(half).best.axis()
        left = force - axis.other_forces(force, position, speed, acceleration) - axis.friction(speed)
    ours, plain, broken = (
        float(np.sqrt(np.mean(error[second] ** 2)) / np.std(force[second])) for error in (left, *errors)
    )
    return ours, plain, broken


#: machines of each kind with each motion
SEEDS = 2
#: the parameters that are judged, with their symbols
SYMBOLS = {"mass": "M", "viscous": "b", "coulomb": "c"}
#: loggers of the machines that are rigid, yield or have play: one that runs with the loop, and one that is slower and
#: whose rows jitter
LOGGERS = {
    "16 bits": Logging(duration=8.0, rate=200.0, counts=2.0**16, slowest=0.2, fastest=1.2),
    "12 bits, uneven": Logging(
        duration=8.0, rate=200.0, counts=2.0**12, slowest=0.2, fastest=1.2, held=False, jitter=0.4
    ),
}


def draw_drive(kind: str, logging: Logging, seed: int) -> tuple[Machine, Logging]:
    """Return a random slide or pendulum, or a wheel behind a drive with play or that yields, and its logger."""
    random = np.random.default_rng([seed, *kind.encode()])
    slides = kind == "slide"
    mass = 10.0 ** random.uniform(-1.0, 1.0)
    dry = mass * random.uniform(1.0, 4.0) * (0.3 if slides else 1.0)
    machine = Machine(
        kind="cart" if slides else kind,
        inertia=mass,
        viscous=dry * random.uniform(0.2, 1.0) * (3.0 if slides else 1.0),
        coulomb=dry,
        offset=dry * random.uniform(-0.2, 0.2),
        gravity=(mass * random.uniform(4.0, 12.0), 0.0) if kind == "pendulum" else (0.0, 0.0),
    )
    share = random.uniform(0.3, 0.6)
    if kind == "play":
        drive = Drive(share=share, natural=80.0, damping=0.1, play=random.uniform(5e-4, 4e-3))
        machine = replace(machine, drive=drive)
    elif kind == "elastic":
        machine = replace(machine, drive=Drive(share=share, natural=random.uniform(15.0, 40.0)))
    amplitude = random.uniform(0.2, 0.4) if slides else random.uniform(0.8, 1.5)
    return machine, replace(logging, amplitude=amplitude, force_noise=0.02 * dry)


@dataclass(frozen=True, kw_only=True)
class Trial:
    """How one simulated machine was identified."""

    errors: dict[str, float]  #: of the parameters, as shares of the truth
    halves: dict[str, float]  #: half widths of the 95 % intervals, likewise
    refused: str = ""  #: the sentence with which it was refused


def trial(machine: Machine, logging: Logging, seed: int) -> Trial:
    """Identify one machine from one record with the law coulomb, all else selected."""
    record = record_of(machine, logging, seed)
    try:
        stopping = [finding for finding in record_findings(record) if finding.severity == "error"]
        if stopping:
            raise InputError(stopping[0].text)
        best = identify_axis(record, options=AxisOptions(law="coulomb")).best
    except InputError as error:
        return Trial(errors={}, halves={}, refused=str(error))
    truth = {"mass": machine.inertia, "viscous": machine.viscous, "coulomb": machine.coulomb}
    return Trial(
        errors={name: best.values[name] / value - 1.0 for name, value in truth.items()},
        halves={name: best.half_widths[name] / value for name, value in truth.items()},
    )


def _trials() -> Iterator[tuple[str, list[Trial]]]:
    """Yield the trials of each row."""
    motions: tuple[Motion, ...] = get_args(Motion)
    for logger, logging in LOGGERS.items():
        for kind in ("slide", "pendulum", "play", "elastic"):
            drawn = [
                (*draw_drive(kind, replace(logging, motion=motion), seed), seed)
                for seed in range(100, 100 + SEEDS)
                for motion in motions
            ]
            yield f"{kind}, {logger}", [trial(*arguments) for arguments in drawn]


def machines() -> Section:
    """Identify simulated machines and return the section of docs/generated/evidence.md."""
    table = dict(_trials())
    rows = [[name, *_distribution(trials)] for name, trials in table.items()]
    everything = [trial for trials in table.values() for trial in trials]
    rows.append(["all", *_distribution(everything)])
    refused = [
        f"{name}: {trial.refused}" for name, trials in table.items() for trial in trials if trial.refused
    ]
    return Section(
        title="One axis: simulated machines",
        before="Random machines (tests/support/axis_machines.py), "
        "simulated apart from Ballbot and identified with the law "
        f"coulomb, all else selected. {SEEDS} seeds with each of three motions, 8 s at 200 Hz: a slide and a "
        "pendulum with rigid drives, and wheels that drive 30 to 60 % of the inertia by gears with a play of 0.5 to 4 "
        "mrad to either side, or by an elastic shaft (15 to 40 Hz); the uneven log comes from a loop at 1 kHz. "
        "Of mass M, viscous friction b and Coulomb friction c: the median "
        "and the largest error and the median half width of the 95 % interval, as shares of the truth, and how many "
        "intervals contain it, at the end with the 95 % interval of that share (Clopper and Pearson).",
        columns=[
            "machine and record",
            *(f"{symbol} {what}" for symbol in SYMBOLS.values() for what in ("error, half [%]", "covered")),
        ],
        rows=rows,
        after=f"Refused: {'; '.join(refused)}" if refused else "None was refused.",
    )


def _distribution(trials: Sequence[Trial]) -> list[str]:
    done = [trial for trial in trials if not trial.refused]
    if not done:
        return ["refused", "", "", "", "", ""]
    texts = []
    for name in SYMBOLS:
        sizes = 100.0 * np.abs([trial.errors[name] for trial in done])
        halves = 100.0 * np.array([trial.halves[name] for trial in done])
        inside = int(np.sum(sizes <= halves))
        covered = f"{inside} of {len(done)}"
        if len(done) > 2 * 3 * SEEDS:
            covered += f", {share_words(inside, len(done))}"
        texts += [f"{np.median(sizes):.2g}, {sizes.max():.2g}; {np.median(halves):.2g}", covered]
    return texts

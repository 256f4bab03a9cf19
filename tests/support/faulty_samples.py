"""Records and logs with faulty samples, drawn from seeds, each beside a sound twin of the same seed.

`friction_record` has the friction torque of a joint beside its speed, without the inertia's part, as papers on friction
publish it; its sound twin is the torque that drives the same joint, with its inertia.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.axis import AxisRecord, identify_axis, record_of_rows
from ballbot.identification.axis.checks import record_findings
from ballbot.log.mapping_search.motion import Stated
from ballbot.log.proposal import Proposal, evaluate, propose
from tests.support.contradicting_logs import Outcome, drawn_habits, team_names
from tests.support.foreign_log_examples import COURSE, foreign_columns, small_robot, write_foreign

Floats = NDArray[np.float64]

#: rows a second of the friction records [1/s], and their duration [s]
RATE, DURATION = 100.0, 40.0
#: [s], correlation time of what no law of friction explains, as temperature and the place of the teeth
DRIFT = 0.5


def friction_record(law: str, seed: int, *, noise: float, sound: bool = False) -> tuple[AxisRecord, float]:
    """Return the record of a joint that moves slowly to and fro, and its Coulomb friction [N m].

    Half of the seeds hold several speeds, the others pass through all. `noise` is what no law explains, over the
    friction's own deviation. The `sound` twin moves faster and has the whole torque.
    """
    random = np.random.default_rng([70, seed, *law.encode()])
    t = np.arange(round(DURATION * RATE)) / RATE
    speed = _held_speeds(t, random) if seed % 2 else _passed_speeds(t, random)
    if sound:
        speed = np.interp((5.0 * t) % t[-1], t, speed)
    speed *= random.uniform(0.5, 2.5) / np.abs(speed).max()
    coulomb, fastest = random.uniform(0.3, 5.0), np.abs(speed).max()
    viscous = coulomb * random.uniform(0.3, 1.2) / fastest
    breakaway = coulomb * random.uniform(0.4, 0.8) if law == "stribeck" else 0.0
    coulomb = 0.0 if law == "viscous" else coulomb
    dry = coulomb + breakaway * np.exp(-np.abs(speed) / (random.uniform(0.05, 0.15) * fastest))
    friction = viscous * speed + dry * np.sign(speed)
    slow = scipy.signal.lfilter([1.0], [1.0, -np.exp(-1.0 / (RATE * DRIFT))], random.standard_normal(len(t)))
    unexplained = noise * friction.std() * np.sqrt(0.5) * (slow / slow.std() + random.standard_normal(len(t)))
    acceleration = np.gradient(speed, 1.0 / RATE)
    inertia = 1.5 * friction.std() / acceleration.std() if sound else 0.0
    torque = friction + unexplained + inertia * acceleration
    measured = speed + 0.005 * fastest * random.standard_normal(len(t))
    position = np.append(0.0, np.cumsum(0.5 * (measured[1:] + measured[:-1]) / RATE))
    return record_of_rows("joint", t, torque, position, unit="rad"), float(coulomb)


def _passed_speeds(t: Floats, random: np.random.Generator) -> Floats:
    """Return a sum of slow sines."""
    frequencies = np.geomspace(0.02, 0.15, 5) * random.uniform(0.9, 1.1, 5)
    return np.sin(2.0 * np.pi * np.outer(t, frequencies) + random.uniform(0.0, 6.0, 5)) @ random.uniform(
        0.5, 1.0, 5
    )


def _held_speeds(t: Floats, random: np.random.Generator) -> Floats:
    """Return speeds that are held for three seconds each, to either side in turn."""
    number = (t / 3.0).astype(int)
    levels = random.uniform(0.1, 1.0, number[-1] + 1) * (-1.0) ** np.arange(number[-1] + 1)
    b, a = np.asarray(scipy.signal.butter(2, 4.0 / RATE))
    return np.asarray(scipy.signal.filtfilt(b, a, levels[number]))


Columns = dict[str, Floats]
#: kinds of faulty samples of a foreign log, by what a logger did
FAULTS = ("failed readings", "one recorded twice", "no heading", "changes of the counts")


def with_fault(table: Columns, fault: str, *, wheels: list[str], lean: list[str], seed: int) -> Columns:
    """Return a foreign log's columns as a faulty logger writes them; `lean` are roll, pitch and yaw."""
    random, changed = np.random.default_rng([71, seed, *fault.encode()]), {**table}
    match fault:
        case "failed readings":  # of some of the encoders
            every, first = int(random.integers(3, 40)), int(random.integers(0, 3))
            for name in random.permutation(wheels)[: random.integers(1, len(wheels) + 1)].tolist():
                read = table[name].copy()
                read[first::every] = 0.0
                changed[name] = read
        case "one recorded twice":
            one, other = random.permutation(wheels if random.random() < 0.5 else lean[:2])[:2].tolist()
            changed[other] = table[one]
        case "no heading":
            changed[lean[2]] = np.full_like(table[lean[2]], random.choice([999.0, -1.0, 0.0, 180.0]))
        case "changes of the counts":
            for name in wheels:
                changed[name] = np.diff(table[name], prepend=table[name][:1])
        case _:
            raise ValueError(fault)
    return changed


#: the course's columns, and what its logs have beside
WHEELS, LEAN = ["psi_1", "psi_2", "psi_3"], ["theta_x", "theta_y", "theta_z"]
HABITS = replace(COURSE, wheel_unit="counts", gyro_unit="deg/s")
#: refusals by the fault
REFUSALS = {"one recorded twice": "have the same values", "changes of the counts": "changes from row to row"}


def fault_outcome(folder: Path, fault: str, *, seed: int, sound: bool) -> Outcome:
    """Return the outcome of a foreign log with a fault by a seed, or of its sound twin.

    Right is the twin's log, to the distance that a wheel moves in a row, with a warning that names the fault.
    """
    random = np.random.default_rng([72, seed])
    table = sound_table = foreign_columns(drawn_habits(random, HABITS))
    names = team_names([*table], random)
    if not sound:
        table = with_fault(table, fault, wheels=WHEELS, lean=LEAN, seed=seed)
    found = proposed(folder, table, names)
    warned = {one.code for one in found.findings if one.severity == "warning"}
    if found.log is None:
        return "refused" if not sound and REFUSALS.get(fault, "-") in found.refusal else "wrong"
    if sound:
        return "wrong" if warned & {"missing", "constant"} else "right"
    twin = proposed(folder, sound_table, names).log
    counts = fault == "failed readings"
    columns = ("wheel1", "wheel2", "wheel3") if counts else ("psi",)
    if fault in REFUSALS or ("missing" if counts else "constant") not in warned or twin is None:
        return "wrong"
    t = np.arange(3.0, 26.0, 0.01)
    for name in columns:
        ours, theirs = (np.interp(t, log.t, log[name]) for log in (found.log, twin))
        off, step = ours - theirs, 1.3 * float(np.abs(np.diff(theirs)).max())
        # a heading by the gyro's integral has the gyro's errors
        if np.abs(off - off.mean()).max() > (max(0.02, step) if counts else 0.1):
            return "wrong"
    return "right"


def proposed(folder: Path, table: Columns, names: dict[str, str]) -> Proposal:
    """Return what is proposed for the columns of a log, with a team's names."""
    path = write_foreign(folder / "run.txt", {names[name]: table[name] for name in table}, HABITS)
    return evaluate(propose(path, small_robot(), Stated(command="duty")))


def friction_outcome(seed: int, *, sound: bool) -> Outcome:
    """Return the outcome of a joint's record by a seed, or of its sound twin.

    By turns, it has the friction torque alone, or forces from elsewhere.
    """
    law, alone = ("coulomb", "viscous")[seed % 2], not sound and seed % 4 < 2
    noise = 0.05 if sound else 0.35 if alone else 1.0
    record, coulomb = friction_record(law, seed, noise=noise, sound=not alone)
    codes = {finding.code for finding in record_findings(record) if finding.severity == "error"}
    if codes:
        return "refused" if alone and codes == {"excitation"} else "wrong"
    try:
        best = identify_axis(record).best
    except InputError as error:
        named = "plain regression" in str(error) or "end of its range" in str(error)
        return "refused" if named and not sound else "wrong"
    # three standard errors; a law without dry friction has none to compare
    allowed = 1.5 * best.half_widths.get("coulomb", np.inf)
    off = abs(best.values.get("coulomb", 0.0) - coulomb)
    return "right" if off <= max(allowed, 0.1 * coulomb) else "wrong"

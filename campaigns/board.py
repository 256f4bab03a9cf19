"""The firmware on an emulated board against Python's controller on the twin: the square of the league, seed by seed.

.venv/bin/python -m campaigns.evidence board

Both control the same twin with the same seeds. Python's controller and estimator compute in float64. The firmware,
built by arm-none-eabi-gcc, runs on a Cortex-M4F under QEMU, gets the readings over the serial line and returns torques.
Where a limit cycle amplifies rounding, two runs that differ in the last bit differ by millimetres some seconds
later: the question is whether their errors differ on average.

A run is kept in build/board as soon as it is complete, under a digest of the firmware and its numbers, and is not made
again: an interrupted campaign continues.
"""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass
from hashlib import sha256
from itertools import product
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy import stats

from ballbot import Controller, Robot, simulate
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.estimation import named_estimator
from ballbot.firmware.export import Export, export_controller
from ballbot.log import Log
from ballbot.rounding import unit_heading
from ballbot.twin import Scenario, Twin
from ballbot.workflows.comparison import CONFIDENCE, Estimate, Paired, mean_with_interval
from ballbot.workflows.courses import LEAGUE, Course, choose_courses
from ballbot.workflows.league import METRIC_BY_KEY
from ballbot.workflows.metrics import score
from campaigns.section import Section, is_kept
from tests.support.board_controller import FirmwareController, ReadingTap
from tests.support.qemu import BoardLine, QemuBoard, build_board

#: of the square, by controller. The nominal one's wandering scatters so much that no campaign would reach the target.
SEEDS = {"nominal, partial": range(300, 306), "precise": range(300, 320)}
#: of a minute on a spot
HOLD_SEED = 300
SIDES = ("Python", "board")
_METRICS = ("peak_position_error", "rms_position_error", "high_frequency_torque")
#: half width that the interval of the mean difference of the peaks should have [m]
_WANTED = 1e-3
_FOLDER = Path(__file__).parents[1] / "build" / "board"
#: of what is exported, which the numbers of a run do not depend on
_WITHOUT_EFFECT = (
    "ballbot/link/",
    "ballbot/drivers/",
    "examples/",
    "README.md",
    "Makefile",
    "CMakeLists.txt",
)
_COMMENT = re.compile(r"/\*.*?\*/", flags=re.DOTALL)


@dataclass(frozen=True, kw_only=True)
class BoardRun:
    """One run's errors."""

    peak_position_error: float  #: [m]
    rms_position_error: float  #: [m]
    high_frequency_torque: float  #: [N m]
    ended: str | None  #: why it ended early
    seconds: float  #: that it took


def robot() -> Robot:
    """Return the thesis's robot as its team knows it: with the nominal twin's friction."""
    alten = Robot.load("alten")
    return alten.replace(friction=Scenario.nominal(alten).friction)


def controllers() -> dict[str, Controller]:
    """Return the controllers by name."""
    return {
        "nominal, partial": nominal_controller(robot(), compensation="partial"),
        "precise": precise_controller(robot()),
    }


def courses() -> dict[str, Course]:
    """Return the courses by name."""
    return {
        one.name: one for one in choose_courses(LEAGUE, robot(), "twin") if one.name in ("square", "hold")
    }


def python_log(controller: Controller, course: Course, *, seed: int, duration: float) -> Log:
    """Return the log of Python's controller."""
    plant = course.plant(robot())(controller.estimator)
    reference = course.reference_spec.reference()
    return simulate(plant, controller, reference, duration=duration, seed=seed)


def board_log(image: Path, controller: Controller, course: Course, *, seed: int, duration: float) -> Log:
    """Return the log of the firmware on a board that is started for it; states are those of Python's estimator."""
    known, h = robot(), controller.sample_time
    tap = ReadingTap(named_estimator(controller.estimator, known, sample_time=h))
    twin = Twin(known, course.scenario, estimator=tap)
    reference = course.reference_spec.reference()
    with QemuBoard(image) as board:
        firmware = FirmwareController(BoardLine(board), tap, robot=known, sample_time=h)
        return simulate(twin, firmware, reference, duration=duration, seed=seed)


def digest_of(exported: Export) -> str:
    """Return a digest of all that the torques of a firmware follow from, comments left out."""
    texts = [
        f"{path}\n{_COMMENT.sub('', text)}"
        for path, text in exported.files.items()
        if not path.startswith(_WITHOUT_EFFECT)
    ]
    return sha256("\n".join(texts).encode()).hexdigest()[:16]


def run(side: str, image: Path, controller: Controller, course: Course, seed: int) -> BoardRun:
    """Make one run."""
    began = perf_counter()
    if side == "Python":
        log = python_log(controller, course, seed=seed, duration=course.duration)
    else:
        log = board_log(image, controller, course, seed=seed, duration=course.duration)
    found = score(log, settle=course.settle, disturbed=course.disturbed)
    errors = {key: getattr(found, key) for key in _METRICS}
    return BoardRun(**errors, ended=found.ended, seconds=round(perf_counter() - began, 1))


Key = tuple[str, str, str, int]  #: course, controller, side, seed


def runs() -> dict[Key, BoardRun]:
    """Return all runs; those that were made before are read."""
    known, found = courses(), {}
    with tempfile.TemporaryDirectory(prefix="ballbot-board-") as folder:
        boards = {name: _Board.of(one, Path(folder) / f"{name}.elf") for name, one in controllers().items()}
        for name, board in boards.items():
            wanted = [*(("square", seed) for seed in SEEDS[name]), ("hold", HOLD_SEED)]
            for (course, seed), side in product(wanted, SIDES):
                key = course, name, side, seed
                if key not in board.kept.runs:
                    made = run(side, board.image(), board.controller, known[course], seed)
                    print(*key, made, flush=True)
                    board.kept.add(key, made)
                found[key] = board.kept.runs[key]
    return found


@dataclass(frozen=True)
class _Board:
    """A controller, its firmware, and the runs of both that were made before."""

    controller: Controller
    exported: Export
    path: Path
    kept: _Kept

    @classmethod
    def of(cls, controller: Controller, path: Path) -> _Board:
        exported = export_controller(controller)
        return cls(controller, exported, path, _Kept(_FOLDER / f"{digest_of(exported)}.jsonl"))

    def image(self) -> Path:
        """Return the program, built when it is first asked for."""
        if not self.path.exists():
            build_board(self.exported.files, self.path, toolchain="gcc", self_test=False)
        return self.path


class _Kept:
    """Runs in a file, one a line."""

    def __init__(self, path: Path) -> None:
        self._path = path
        lines = path.read_text(encoding="utf-8").splitlines() if is_kept(path) else []
        rows = [json.loads(line) for line in lines]
        self.runs: dict[Key, BoardRun] = {
            (course, name, side, seed): BoardRun(**values) for (course, name, side, seed), values in rows
        }

    def add(self, key: Key, made: BoardRun) -> None:
        """Keep a run."""
        self.runs[key] = made
        self._path.parent.mkdir(parents=True, exist_ok=True)
        values = dict(zip(BoardRun.__dataclass_fields__, astuple(made), strict=True))
        with self._path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps([key, values]) + "\n")


def pairs_needed(differences: Iterable[float], half_width: float = _WANTED) -> int:
    """Return of how many pairs the 95 % interval of a mean difference has a half width, if they scatter like these."""
    values = list(differences)
    deviation = mean_with_interval(values)
    half = 0.5 * (deviation.high - deviation.low)
    n = len(values)
    scatter = half * math.sqrt(n) / float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, n - 1))
    needed = 2
    while float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, needed - 1)) * scatter / math.sqrt(needed) > half_width:
        needed += 1
    return needed


def rows(found: Mapping[Key, BoardRun], course: str, name: str) -> list[list[str]]:
    """Return the rows of a controller on a course."""
    seeds = sorted({key[3] for key in found if key[:2] == (course, name)})
    if not seeds:
        return []
    python, board = ([found[course, name, side, seed] for seed in seeds] for side in SIDES)
    table = []
    for key in _METRICS:
        metric = METRIC_BY_KEY[key]
        values, others = ([getattr(one, key) for one in side] for side in (board, python))
        means = [f"{metric.scale * mean_with_interval(one).mean:.3f}" for one in (others, values)]
        table.append(
            [
                course,
                name,
                str(len(seeds)),
                unit_heading(metric.words, metric.unit),
                *means,
                _interval(values, others, metric.scale),
            ]
        )
    falls = [str(sum(one.ended is not None for one in side)) for side in (python, board)]
    return [*table, [course, name, str(len(seeds)), "falls", *falls, ""]]


def _interval(values: Sequence[float], others: Sequence[float], scale: float) -> str:
    found: Estimate = Paired.of(values, others).difference
    return f"{scale * found.low:.3f} to {scale * found.high:.3f}" if found.runs > 1 else ""


def campaign() -> Section:
    """Return the differences between the board and Python on the twin."""
    found = runs()
    needed = []
    for name, seeds in SEEDS.items():
        python, board = (
            [found["square", name, side, seed].peak_position_error for seed in seeds] for side in SIDES
        )
        apart = [one - other for one, other in zip(board, python, strict=True)]
        scatter = 1e3 * float(np.nanstd(apart, ddof=1))
        needed.append(f"{name}: {pairs_needed(apart)} (standard deviation {scatter:.2f} mm)")
    seconds = [one.seconds for key, one in found.items() if key[0] == "square" and key[2] == "board"]
    return Section(
        title="The firmware on an emulated board",
        before="The whole firmware on an emulated board (QEMU, MPS2 with a Cortex-M4F) against Python's controller and "
        "estimator in float64, on the nominal twin: sensor messages in and torques out over the emulated serial line. "
        "The square of the league with paired seeds, and a minute on a spot. The last column is the 95 % interval "
        "(Student's) of the mean difference, seed by seed.",
        columns=["course", "controller", "pairs", "number", "Python", "board", "difference"],
        rows=[row for course in courses() for name in controllers() for row in rows(found, course, name)],
        after="The target is an interval of the mean difference of the peaks on the square within +-1 mm. Pairs for a "
        f"half width of 1 mm, at the scatter of these: {'; '.join(needed)}. A run of 32 s on the board took "
        f"{min(seconds):.0f} to {max(seconds):.0f} s on one core of this computer, which did other work, too.",
    )

"""Measure Ballbot on other people's logs of every kind that it reads or refuses by name, each with a sound twin.

BALLBOT_KINDS=1 BALLBOT_KINDS_SEED=41 .venv/bin/python -m campaigns.evidence foreign_kinds    one a kind, other logs

The generators are those of the tests: `foreign_tables` (clocks and dialects), `contradicting_logs` (units, columns that
were not read, commands, logs in Ballbot's format) and `faulty_samples`. A result is

right      what is read is the truth, with a warning if samples are faulty
refused    a sentence names what is wrong
wrong      anything else: silently wrong, or a sentence on something else
"""

import os
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from ballbot.fitting.run import Processes
from campaigns.mapping_corpus import PROCESSES
from campaigns.section import Section, finished, share_words
from tests.support import contradicting_logs, faulty_samples, foreign_tables
from tests.support.contradicting_logs import Outcome

#: drawn after the last change of what is judged; seeds below 10,000 are those of development
SEED = 199588
#: logs of each kind, and as many twins: of 33 kinds 231 of both
OF_A_KIND = 7
#: environment variables: logs of each kind, and the seed
COUNT, SEED_KEY = "BALLBOT_KINDS", "BALLBOT_KINDS_SEED"
FRICTION = "friction alone, or forces from elsewhere"
KINDS = (*foreign_tables.KINDS, *contradicting_logs.KINDS, *faulty_samples.FAULTS, FRICTION)


@dataclass(frozen=True, kw_only=True)
class Case:
    """A log of a kind by a seed, or its sound twin."""

    kind: str
    seed: int
    sound: bool


def judged(case: Case) -> Outcome:
    """Return the outcome of a log; that of a sound twin is "refused" if it is not right, and a sentence says why."""
    kind, seed, sound = case.kind, case.seed, case.sound
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if kind == FRICTION:
            return faulty_samples.friction_outcome(seed, sound=sound)
        if kind in faulty_samples.FAULTS:
            return faulty_samples.fault_outcome(folder, kind, seed=seed, sound=sound)
        if kind in contradicting_logs.KINDS:
            return contradicting_logs.outcomes(kind, seed=seed, sound=sound)
        file = foreign_tables.pair_of(kind, seed)[sound]
        result, words = foreign_tables.outcome(file, folder / "run.csv")
        named = bool(file.refusal) and file.refusal in words
        return "wrong" if result == "refused" and not (sound or named) else result


def campaign() -> Section:
    """Judge the logs and return the section of docs/generated/evidence.md."""
    count, seed = int(os.environ.get(COUNT, OF_A_KIND)), int(os.environ.get(SEED_KEY, SEED))
    cases = {
        f"{kind}_{number}{'_sound' * sound}": Case(kind=kind, seed=number, sound=sound)
        for kind in KINDS
        for number in range(seed, seed + count)
        for sound in (False, True)
    }
    workers = Processes(count=int(os.environ[PROCESSES]) if PROCESSES in os.environ else None)
    packages = ["log", "identification", "validation"]
    outcomes = finished("foreign_kinds", judged, cases, packages=packages, workers=workers)
    counts = Counter((case.kind, case.sound, outcomes[name]) for name, case in cases.items())
    columns = [(sound, result) for sound in (False, True) for result in ("right", "refused", "wrong")]
    rows = [[kind.replace("_", " "), *(str(counts[kind, *column]) for column in columns)] for kind in KINDS]
    sums = [sum(counts[kind, *column] for kind in KINDS) for column in columns]
    sounds = {name: case.sound for name, case in cases.items()}
    bad = [name for name, one in outcomes.items() if one == "wrong" or (sounds[name] and one != "right")]
    of = count * len(KINDS)
    return Section(
        title="Kinds of foreign logs, right or refused by name",
        before=f"{of} logs of {len(KINDS)} kinds of other people's logs, and as many sound twins, by seeds from {seed}"
        " (generators in `tests/support`). Right is the truth as read, refused a sentence that names the matter, wrong"
        " anything else. Intervals are of 95 % by Clopper and Pearson.",
        columns=["kind", *(f"{'twin ' * sound}{result}" for sound, result in columns)],
        rows=[*rows, ["all", *map(str, sums)]],
        after=f"Wrong: {share_words(sums[2], of)} of the logs; refused or wrong: {share_words(sums[4] + sums[5], of)}"
        f" of the twins ({', '.join(bad) or 'none'}). {COUNT} is the number of logs of a kind.",
    )

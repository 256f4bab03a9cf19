"""Run the property tests with random examples; `make test` repeats the same ones.

.venv/bin/python -m campaigns.evidence exploration
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections import Counter
from pathlib import Path

from campaigns.section import Section

SEEDS = 20
ROOT = Path(__file__).parents[1]


def campaign() -> Section:
    """Return how often each property was refuted, over all seeds."""
    outcomes = [explore(seed) for seed in range(SEEDS)]
    refuted = Counter(name for outcome in outcomes for name, held in outcome.items() if not held)
    names = {name for outcome in outcomes for name in outcome}
    return Section(
        title="Property tests with random examples",
        before="All property tests (Hypothesis) that are not slow, each with its number of examples, once per seed. "
        "`make test` runs them with the same examples every time.",
        columns=["", "seeds", "held", "refuted"],
        rows=[
            [
                "all properties together",
                f"{SEEDS}",
                f"{len(names) - len(refuted)} of {len(names)}",
                f"{len(refuted)}",
            ],
            *([name, f"{SEEDS}", f"{SEEDS - count}", f"{count}"] for name, count in sorted(refuted.items())),
        ],
    )


def explore(seed: int, *, tests: str = "tests") -> dict[str, bool]:
    """Run the property tests with the examples of a seed and return, by their names, which held."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        chosen = [
            "-m",
            "hypothesis and not slow",
            f"--hypothesis-seed={seed}",
            "-n",
            "auto",
            f"--junitxml={report}",
        ]
        subprocess.run(
            [sys.executable, "-m", "pytest", *chosen, tests],
            cwd=ROOT,
            env=os.environ | {"BALLBOT_EXAMPLES": "exploring"},
            stdout=subprocess.DEVNULL,
            check=False,
        )
        cases = ElementTree.parse(report).getroot().iter("testcase")
        return {
            f"{case.get('classname')}.{case.get('name')}": not (
                case.findall("failure") + case.findall("error")
            )
            for case in cases
        }

"""Long campaigns, each a section of docs/generated/evidence.md.

.venv/bin/python -m campaigns.evidence                 all of them (make evidence)
.venv/bin/python -m campaigns.evidence convergence     these only; the other sections stay as they are
.venv/bin/python -m campaigns.evidence --stale         names and marks the sections older than their goldens

A section keeps the commit of the code that made it and the packages that its campaign imports. A golden exercises the
packages that its command's module imports. The section is stale if a golden that shares a package with it differs from
that at its commit: its numbers may hold, but nobody has looked.
"""

import ast
import json
import platform
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from time import perf_counter

import numba
import numpy as np
import scipy

from ballbot.cli.app import COMMANDS
from ballbot.files import write_text
from campaigns.section import DataMissingError
from tests.golden.cases import CASES
from tests.golden.compare import differences

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "generated" / "evidence.md"

#: sections in the page's order, and the module whose `campaign()`, or the function after the colon, returns each
CAMPAIGNS = {
    "convergence": "campaigns.convergence",
    "twin_observed": "campaigns.twin_observed",
    "estimation": "campaigns.estimation",
    "slip": "campaigns.slip",
    "slip_alarms": "campaigns.slip:false_alarms",
    "agreement": "campaigns.agreement",
    "strangers": "campaigns.strangers",
    "benchmark": "campaigns.benchmark",
    "feedback_linearisation": "campaigns.feedback_linearisation",
    "fast_moves": "campaigns.fast_moves",
    "learning": "campaigns.learning",
    "learned_league": "campaigns.learned_league",
    "randomisation": "campaigns.randomisation",
    "stable_baselines": "campaigns.stable_baselines",
    "limits": "campaigns.limits",
    "factors": "campaigns.controller_factors",
    "pivoting": "campaigns.pivoting",
    "error_budget": "campaigns.error_budget",
    "further_work": "campaigns.further_work",
    "optima": "campaigns.optima",
    "coverage": "campaigns.coverage",
    "file_values": "campaigns.coverage:file_values",
    "between_logs": "campaigns.between_logs",
    "course_robot": "campaigns.course_robot",
    "effective": "campaigns.between_logs:effective",
    "one_axis": "campaigns.one_axis",
    "axis_joints": "campaigns.one_axis:joints",
    "axis_machines": "campaigns.one_axis:machines",
    "driveline_coverage": "campaigns.stage_coverage:drivelines",
    "upside_down": "campaigns.stage_coverage:upside_down",
    "killed_sweep": "campaigns.killed_sweep",
    "identified_friction": "campaigns.identified_twin:identified_friction",
    "spin": "campaigns.spin",
    "mapping_corpus": "campaigns.mapping_corpus",
    "foreign_kinds": "campaigns.foreign_kinds",
    "motor_faults": "campaigns.motor_faults",
    "board_matrix": "campaigns.board_matrix",
    "firmware_timing": "campaigns.firmware_timing",
    "firmware_numbers": "campaigns.firmware_numbers",
    "firmware_fuzz": "campaigns.firmware_fuzz",
    "tune_sequences": "campaigns.tune_sequences",
}

_HEAD = """# Evidence

The results of long campaigns, of which the tests run samples. `make evidence` writes this page; the command under a
section writes that section alone. Behind it stand the commit that made it and the packages that it depends on; a
section is stale if results of commands that exercise them have changed since (`python -m campaigns.evidence --stale`).
The sections on the EMPS benchmark, joints of arms and a course's robot need public records (see [one axis](../axis.md)
and [a real robot](../real_robots.md)): they are written if BALLBOT_DATA names the folder with `emps/DATA_EMPS.mat`,
`axes` and `rob311`, and stay as they are if not.

"""


def main(names: Sequence[str]) -> None:
    """Run the campaigns of these names, or all, and write their sections."""
    unknown = sorted(set(names) - set(CAMPAIGNS))
    if unknown:
        raise SystemExit(f"There is no campaign {unknown[0]!r}; there are {', '.join(CAMPAIGNS)}.")
    for name in names or CAMPAIGNS:
        started = perf_counter()
        module, _, function = CAMPAIGNS[name].partition(":")
        try:
            section = getattr(import_module(module), function or "campaign")().markdown()
        except DataMissingError as missing:
            print(f"{name} is not written: {missing}.")
            continue
        sections = written_sections()  # another run may have written meanwhile
        sections[name] = f"{section}\n{_origin(name, perf_counter() - started)}\n"
        print(section)
        _write(sections)


def _write(sections: Mapping[str, str]) -> None:
    parts = [f"<!-- {known} -->\n{sections[known]}" for known in CAMPAIGNS if known in sections]
    write_text(PAGE, _HEAD + "\n".join(parts))


def written_sections() -> dict[str, str]:
    """Return the sections that the page has, by name."""
    if not PAGE.exists():
        return {}
    parts = re.split(r"^<!-- (\w+) -->\n", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return {name: text.rstrip("\n") + "\n" for name, text in zip(parts[::2], parts[1::2], strict=True)}


def _origin(name: str, seconds: float) -> str:
    versions = f"NumPy {np.__version__}, SciPy {scipy.__version__}, Numba {numba.__version__}"
    packages = sorted(packages_of(ROOT / f"{CAMPAIGNS[name].partition(':')[0].replace('.', '/')}.py"))
    commit = _git("rev-parse", "--short=8", "HEAD").strip()
    return (
        f"`python -m campaigns.evidence {name}`, {seconds:.0f} s on {platform.machine()} {platform.system()}, "
        f"Python {platform.python_version()}, {versions}. Made at {commit}; depends on "
        f"{', '.join(packages) or 'no package'}."
    )


#: packages by which no golden is chosen: of every command, of every robot, and where work is done
_EVERYWHERE = {"cli", "fitting", "report", "robot"}
_MADE = re.compile(r"Made at (\w+); depends on ([\w, ]*)\.")
_MARK = re.compile(r" \*\*Stale\*\*: .*")


def packages_of(path: Path) -> set[str]:
    """Return the packages that a file, and what it imports of campaigns and tests, import by themselves."""
    tree, packages = ast.parse(path.read_text(encoding="utf-8")), set[str]()
    for node in (found for found in ast.walk(tree) if isinstance(found, ast.ImportFrom)):
        top, _, rest = (node.module or "").partition(".")
        if top == "ballbot" and (ROOT / "src" / "ballbot" / rest.partition(".")[0]).is_dir():
            packages.add(rest.partition(".")[0])
        elif top in ("campaigns", "tests"):
            module = ROOT / top / rest.replace(".", "/")
            names = [name.name for name in node.names] if module.is_dir() else [f"../{module.name}"]
            files = [(module / f"{name}.py").resolve() for name in names]
            packages |= set().union(*(packages_of(f) for f in files if f.stem not in ("section", path.stem)))
    return packages - {"", *_EVERYWHERE}


def mark_stale() -> None:
    """Name the sections with whose packages commands give other results than at their commits, and mark them."""
    modules = {command.name: command.target[0].replace(".", "/") for command in COMMANDS}
    commands = {case.name: case.words[0] for case in CASES if case.words}
    exercised = {case: packages_of(ROOT / "src" / f"{modules[name]}.py") for case, name in commands.items()}
    sections = written_sections()
    for name, section in sections.items():
        commit, packages = next(iter(_MADE.findall(section)), ("HEAD", ""))
        shared = [case for case in changed(commit) if exercised[case] & set(packages.split(", "))]
        text, mark = _MARK.sub("", section).rstrip("\n"), ""
        if others := sorted({commands[case] for case in shared}):
            print(f"{name}: {', '.join(others)}")
            mark = f" **Stale**: other results since then of `{'`, `'.join(others)}`."
        sections[name] = f"{text}{mark}\n"
    _write(sections)


@cache
def changed(commit: str) -> list[str]:
    """Return the goldens with another result than at a commit; keys that come or go are no result."""
    found = []
    for path in _git("diff", "--name-only", "--diff-filter=M", commit, "--", "tests/golden/results").split():
        texts = _git("show", f"{commit}:{path}"), (ROOT / path).read_text(encoding="utf-8")
        lines = differences("", *map(json.loads, texts), same_machine=True)
        found += [Path(path).stem] if any("(absent)" not in line for line in lines) else []
    return found


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout


if __name__ == "__main__":
    mark_stale() if sys.argv[1:] == ["--stale"] else main(sys.argv[1:])

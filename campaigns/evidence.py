"""Long campaigns, each a section of docs/generated/evidence.md.

.venv/bin/python -m campaigns.evidence                 all of them (make evidence)
.venv/bin/python -m campaigns.evidence convergence     these only; the other sections stay as they are
"""

import platform
import re
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from time import perf_counter

import numba
import numpy as np
import scipy

from ballbot.files import write_text
from campaigns.section import DataMissingError

PAGE = Path(__file__).parents[1] / "docs" / "generated" / "evidence.md"

#: sections in the page's order, and the module whose `campaign()`, or the function after the colon, returns each
CAMPAIGNS = {
    "convergence": "campaigns.convergence",
    "twin_observed": "campaigns.twin_observed",
    "estimation": "campaigns.estimation",
    "agreement": "campaigns.agreement",
    "prediction": "campaigns.controller_prediction",
    "benchmark": "campaigns.benchmark",
    "fast_moves": "campaigns.fast_moves",
    "learning": "campaigns.learning",
    "learned_league": "campaigns.learned_league",
    "randomisation": "campaigns.randomisation",
    "stable_baselines": "campaigns.stable_baselines",
    "limits": "campaigns.limits",
    "choice": "campaigns.controller_factors:choice",
    "factors": "campaigns.controller_factors",
    "pivoting": "campaigns.pivoting",
    "further_work": "campaigns.further_work",
    "optima": "campaigns.optima",
    "coverage": "campaigns.coverage",
    "between_logs": "campaigns.between_logs",
    "course_robot": "campaigns.course_robot",
    "effective": "campaigns.between_logs:effective",
    "one_axis": "campaigns.one_axis",
    "axis_machines": "campaigns.one_axis:machines",
    "driveline_coverage": "campaigns.stage_coverage:drivelines",
    "upside_down": "campaigns.stage_coverage:upside_down",
    "killed_sweep": "campaigns.killed_sweep",
    "identified_friction": "campaigns.identified_twin:identified_friction",
    "spin": "campaigns.spin",
    "mapping_corpus": "campaigns.mapping_corpus",
    "motor_faults": "campaigns.motor_faults",
    "board_matrix": "campaigns.board_matrix",
    "firmware_timing": "campaigns.firmware_timing",
    "firmware_numbers": "campaigns.firmware_numbers",
    "firmware_fuzz": "campaigns.firmware_fuzz",
    "tune_sequences": "campaigns.tune_sequences",
}

_HEAD = """# Evidence

The results of long campaigns, of which the tests run samples. `make evidence` writes this page; the command under a
section writes that section alone. The sections on the EMPS benchmark and on a course's robot need public records (see
[one axis](../axis.md) and [a real robot](../real_robots.md)): they are written if BALLBOT_DATA names the folder with
`emps/DATA_EMPS.mat` and `rob311`, and stay as they are if not.

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
    return (
        f"`python -m campaigns.evidence {name}`, {seconds:.0f} s on {platform.machine()} {platform.system()}, "
        f"Python {platform.python_version()}, {versions}."
    )


if __name__ == "__main__":
    main(sys.argv[1:])

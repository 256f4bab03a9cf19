"""In which order the tests run, and which files stay together on one worker.

The fast tests run first, then the slow ones, then the samples. Among each, the files that take longest come first, so
that no worker is left with one of them at the end. The first file of the fast ones compiles the engine that most others
then read from disk; the next ones, on another worker, need other engines or none for as long as that takes.
"""

import pytest
from xdist.scheduler import LoadScopeScheduling

#: Beginnings of files' paths; other files come after these. Files of a tuple stay together, since they share what takes
#: seconds to make: a drawn ball, logs, a derivation by SymPy, the parsed source.
ORDER: tuple[str | tuple[str, ...], ...] = (
    "tests/test_memory.py",
    "tests/test_golden.py",
    "tests/test_bring_up.py",
    "tests/test_whole_trip.py",
    "tests/control/test_parts.py",
    ("tests/vision/",),
    ("tests/validation/test_alignment",),
    "tests/control/test_missing_samples.py",
    "tests/log/test_course_logs.py",
    "tests/workflows/test_study.py",
    "tests/identification/test_identify.py",
    "tests/identification/test_upside_down.py",
    "tests/mechanics/test_convex_step.py",
    "tests/log/test_wrong_logs.py",
    ("tests/mechanics/test_equations.py", "campaigns/tests/test_published"),
    "tests/identification/test_ladder.py",
    "tests/workflows/test_excite.py",
    "tests/workflows/test_controller_prediction.py",
    "tests/log/test_mapping_search.py",
    (
        "tests/validation/test_residuals.py",
        "tests/validation/test_validation.py",
        "tests/validation/test_model",
    ),
    "tests/mechanics/test_friction_law.py",
    "tests/fitting/test_between_logs.py",
    "tests/identification/test_driveline.py",
    "tests/firmware/",
    "tests/workflows/",
    "tests/mechanics/",
    "tests/simulation/",
    ("tests/test_findings.py", "tests/test_structure.py"),
    "tests/cli/",
    "tests/control/",
    "tests/twin/",
    "tests/identification/",
)


def place_of(item: pytest.Item) -> tuple[bool, bool, int]:
    """Return what tests are sorted by."""
    sample, slow = (item.get_closest_marker(name) is not None for name in ("sample", "slow"))
    return sample, slow and not sample, _place(_file(item.nodeid))


class InOrder(LoadScopeScheduling):
    """Gives a worker that has little left the next file, in the order in which the tests were collected."""

    def __init__(self, config: pytest.Config, log: object = None) -> None:
        config.option.loadscopereorder = False  # it would begin with the files of the most tests
        super().__init__(config, log)
        self._scopes: dict[str, str] = {}
        self._unit: int | str = ""
        self._begun = 0

    def _split_scope(self, nodeid: str) -> str:
        """Return the scope of a test. A file whose tests come in parts, fast, slow and samples, has several."""
        if nodeid not in self._scopes:  # xdist asks for all of them first, in order
            unit = _unit(_file(nodeid))
            self._begun += unit != self._unit
            self._unit = unit
            self._scopes[nodeid] = f"{self._begun} {unit}"
        return self._scopes[nodeid]


def _file(nodeid: str) -> str:
    return nodeid.partition("::")[0]


def _place(file: str) -> int:
    return next((place for place, names in enumerate(ORDER) if file.startswith(names)), len(ORDER))


def _unit(file: str) -> int | str:
    """Return the place of the files that a file stays with, or the file if it goes alone."""
    place = _place(file)
    return place if place < len(ORDER) and isinstance(ORDER[place], tuple) else file

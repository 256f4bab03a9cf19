"""What tests share."""

import gc
import os
import sys
import tempfile
from collections.abc import Generator, Mapping
from pathlib import Path

# one thread of BLAS: several processes test side by side, and waiting threads would take the cores from each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported
# the processes that tests start read what the first of them compiles of the source
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

import hypothesis
import pytest
from numba.core.dispatcher import Dispatcher

from tests.support.schedule import InOrder, place_of

#: category, letter and word of a test's outcome, as pytest's reporter shows them
Status = tuple[str, str, str | tuple[str, Mapping[str, bool]]]

# compilers and parsers make millions of objects that stay: with garbage looked for less often, parsing the source takes
# 1.2 s instead of 2.9 s
gc.set_threshold(20_000, 20, 20)

# the same examples in every run, forty unless a test states another number; with BALLBOT_EXAMPLES=exploring other ones,
# a hundred of them
hypothesis.settings.register_profile("same", derandomize=True, database=None, deadline=None, max_examples=40)
hypothesis.settings.register_profile("exploring", database=None, deadline=None, print_blob=True)
hypothesis.settings.load_profile(os.environ.get("BALLBOT_EXAMPLES", "same"))


@pytest.fixture(scope="session", autouse=True)
def _no_file_stays(  # pyright: ignore[reportUnusedFunction]
    tmp_path_factory: pytest.TempPathFactory,
) -> Generator[None]:
    """Put temporary files of tests, and of processes that they start, where pytest removes them at the end."""
    folder = str(tmp_path_factory.mktemp("temporary"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", folder)
        patch.setattr(tempfile, "tempdir", folder)
        yield


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the fast tests first."""
    items.sort(key=place_of)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> InOrder | None:
    """Return the scheduler of `--dist loadfile`."""
    return InOrder(config, log) if config.getvalue("dist") == "loadfile" else None


@pytest.hookimpl(wrapper=True)
def pytest_report_teststatus(report: pytest.TestReport) -> Generator[None, Status, Status]:
    """Name a failed test at once: a run that is ended before its summary tells by its dots alone nothing."""
    category, letter, word = yield
    if not report.failed:
        return category, letter, word
    cause = next((line for line in report.longreprtext.splitlines() if line.startswith("E  ")), "")
    return category, f"\n{word if isinstance(word, str) else word[0]} {report.nodeid} {cause}\n", word


RUN_AT_COLLECTION = pytest.StashKey[list[str]]()


def pytest_collection_finish(session: pytest.Session) -> None:
    """Note which compiled functions ran while tests were collected; look for garbage no more in what was imported."""
    gc.freeze()
    session.config.stash[RUN_AT_COLLECTION] = sorted(
        f"{name}.{key}"
        for name, module in list(sys.modules.items())
        if name.partition(".")[0] == "ballbot"
        for key, value in vars(module).items()
        if isinstance(value, Dispatcher) and value.signatures
    )


@pytest.fixture(scope="session")
def run_at_collection(request: pytest.FixtureRequest) -> list[str]:
    """Return the compiled functions that ran while tests were collected."""
    return request.config.stash[RUN_AT_COLLECTION]


@pytest.fixture
def undrawn() -> Generator[None]:
    """Leave a page's figures empty where a test reads its words: to draw them takes most of a page's time."""
    from matplotlib.figure import Figure

    empty = Figure()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ballbot.report.style.drawn", lambda _draw, name: (f"<svg><!--{name}--></svg>", empty))
        yield


@pytest.fixture(scope="session")
def browser() -> Generator[object]:
    """Return a running browser, or skip the test without one."""
    from tests.support.browser import headless_browser

    with headless_browser() as running:
        yield running


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of measured data beside the project, or skip the test without it."""
    folder = Path(os.environ.get("BALLBOT_DATA") or Path(__file__).parents[2] / "shared" / "data")
    if not folder.is_dir():
        pytest.skip(f"no data at {folder}; set BALLBOT_DATA")
    return folder

"""What tests share."""

import os
from pathlib import Path

# one thread of BLAS: several processes test side by side, and waiting threads would take the cores from each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported

import hypothesis
import pytest

# the same examples in every run; `python -m campaigns.evidence exploration` looks at other ones
hypothesis.settings.register_profile("same", derandomize=True, database=None, deadline=None)
hypothesis.settings.register_profile("exploring", database=None, deadline=None, print_blob=True)
hypothesis.settings.load_profile(os.environ.get("BALLBOT_EXAMPLES", "same"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of measured data beside the project, or skip the test without it."""
    folder = Path(os.environ.get("BALLBOT_DATA") or Path(__file__).parents[2] / "shared" / "data")
    if not folder.is_dir():
        pytest.skip(f"no data at {folder}; set BALLBOT_DATA")
    return folder

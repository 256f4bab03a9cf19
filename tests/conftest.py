"""What tests share."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of measured data beside the project, or skip the test where there is none."""
    folder = Path(os.environ.get("BALLBOT_DATA") or Path(__file__).parents[2] / "shared" / "data")
    if not folder.is_dir():
        pytest.skip(f"no data at {folder}; set BALLBOT_DATA")
    return folder

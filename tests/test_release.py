"""What a release states about itself: one version everywhere, and the Pythons that CI runs."""

import re
import tomllib
from pathlib import Path

import ballbot

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_version_is_the_same_everywhere() -> None:
    assert PROJECT["version"] == ballbot.__version__
    assert f"\nversion: {ballbot.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(
        rf"^## .*\b{ballbot.__version__}\b", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE
    )


def test_dependencies_have_lower_bounds() -> None:
    extras = [one for name, found in PROJECT["optional-dependencies"].items() for one in found]
    for one in [*PROJECT["dependencies"], *extras]:
        assert ">=" in one or one.startswith("ballbot["), f"{one} has no lowest version"

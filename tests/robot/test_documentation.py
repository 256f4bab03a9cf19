"""The documentation's tables of parameters are those of the dataclasses."""

import pytest

from ballbot.robot import Robot
from ballbot.robot.parameters import markdown_table
from ballbot.twin import Scenario
from tests.support.paths import ROOT

DOCS = ROOT / "docs"
BEGIN, END = "<!-- generated from the schema: begin -->\n", "<!-- generated from the schema: end -->\n"


@pytest.mark.parametrize(
    ("page", "table"),
    [
        ("robot_file.md", markdown_table(Robot)),
        ("twin.md", markdown_table(Scenario, si_only=True)),
    ],
)
def test_documented_parameters_are_those_of_the_schema(page: str, table: str) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    found = text.split(BEGIN)[1].split(END)[0]
    assert found == table, f"docs/{page} is not up to date; put this between its marks:\n{table}"

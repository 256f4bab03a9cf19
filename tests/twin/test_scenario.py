"""Scenarios and their files: read, written, refused."""

from dataclasses import replace
from pathlib import Path

import pytest

from ballbot.errors import InputError
from ballbot.robot import Robot
from ballbot.twin import Scenario
from ballbot.twin.faults import Compliance
from ballbot.twin.scenario_file import EXAMPLES, load_scenario, scenario_text
from tests.support.paths import ROOT

ALTEN = Robot.load("alten").replace({"drive.resistance": 0.6})  # which a supply needs
NOMINAL = Scenario.nominal(ALTEN)


def read(text: str, folder: Path) -> Scenario:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return load_scenario(path, ALTEN)


def test_scenario_file_contains_only_differences(tmp_path: Path) -> None:
    found = read(
        'base = "wide_rows"\nbacklash = 0\n[compliance]\nfrequency = 9\ndamping_ratio = 0.1\n', tmp_path
    )
    assert found == replace(
        Scenario.named("wide_rows", ALTEN),
        name="mine",
        backlash=0.0,
        compliance=Compliance(frequency=9.0, damping_ratio=0.1),
    )


def test_the_examples_of_what_is_off_can_be_switched_on(tmp_path: Path) -> None:
    """Taking the # away from every line that is off gives a scenario with everything on."""
    lines = scenario_text(NOMINAL).splitlines()
    off = [i for i, line in enumerate(lines) if line.startswith("# Off: ")]
    for i in range(off[0], len(lines)):
        if not lines[i].startswith("# Off: "):
            lines[i] = lines[i].removeprefix("# ")
    found = read("\n".join(lines), tmp_path)
    for name, example in EXAMPLES.items():
        assert getattr(found, name) == ((example,) if name == "pushes" else example)
    named = replace(found, name="é \"'\\#", backlash=1.0 / 3.0, pushes=2 * found.pushes)
    assert read(scenario_text(named), tmp_path) == named


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("bcklash = 1", "bcklash is not a key of a scenario file; did you mean 'backlash'?"),
        ("[[pushes]]\nwhen = 1", "pushes[1].when is not a key"),
        ("[compliance]\nfrequency = 1", "compliance.damping_ratio is missing"),
        ("backlash = nan", "backlash is nan rad; it must be finite"),
        ("[friction]\ncoulomb = [0.1, 0.1]", "friction for 2 wheels"),
        ("base = 'nomnal'", "did you mean 'nominal'?"),
        ("base = 3", "base is 3"),
    ],
)
def test_refuses_in_one_sentence(text: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        read(text, tmp_path)
    said = str(refused.value)
    assert sentence in said
    assert str(tmp_path / "mine.toml") in said
    assert "\n" not in said


def test_the_scenario_in_the_documents_is_one(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "twin.md").read_text(encoding="utf-8")
    example = page.split("```toml\n")[1].split("```")[0]
    found = read(example, tmp_path)
    assert found.compliance == Compliance(frequency=40.0, damping_ratio=0.1)
    assert len(found.pushes) == 1
    for name in Scenario.names():
        assert f"`{name}`" in page

"""The page of the campaigns: its sections and the times under them."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest

from campaigns import evidence
from campaigns.evidence import CAMPAIGNS, NOT_ON_THE_PAGE, written_sections
from campaigns.section import Section, is_kept


def test_every_campaign_has_its_section_or_a_reason_for_none() -> None:
    written = written_sections()
    assert [name for name in CAMPAIGNS if name not in NOT_ON_THE_PAGE] == list(written)
    assert set(NOT_ON_THE_PAGE) <= set(CAMPAIGNS)
    for name, section in written.items():
        assert f"`python -m campaigns.evidence {name}`" in section.splitlines()[-1]


@pytest.mark.parametrize(
    ("age", "stated"), [(-3600.0, "from results that an earlier run kept"), (3600.0, "0 s")]
)
def test_time_is_stated_only_of_a_run_that_made_its_results(
    age: float, stated: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def campaign() -> Section:
        assert is_kept(file)
        return Section(title="A sample", before="Text.", columns=["a"], rows=[["1"]])

    file = tmp_path / "kept.json"
    file.touch()
    moment = time.time() + age
    os.utime(file, (moment, moment))
    page = tmp_path / "evidence.md"
    page.write_text("# Evidence\n\n<!-- other -->\n## Kept\n\nwords\n", encoding="utf-8")
    monkeypatch.setattr(evidence, "PAGE", page)
    monkeypatch.setattr(evidence, "CAMPAIGNS", {"other": "", "sample": __name__})
    monkeypatch.setattr(sys.modules[__name__], "campaign", campaign, raising=False)
    evidence.main(["sample"])
    assert f"`python -m campaigns.evidence sample`, {stated}" in written_sections()["sample"]
    assert page.read_text(encoding="utf-8").count("## Kept\n\nwords\n") == 1  # the others stay
    with pytest.raises(SystemExit, match="no campaign 'unknown'"):
        evidence.main(["unknown"])

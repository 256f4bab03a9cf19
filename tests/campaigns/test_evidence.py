"""The page of the campaigns: its sections and the times under them."""

from __future__ import annotations

from campaigns.evidence import CAMPAIGNS, NOT_ON_THE_PAGE, written_sections


def test_every_campaign_has_its_section_or_a_reason_for_none() -> None:
    written = written_sections()
    assert [name for name in CAMPAIGNS if name not in NOT_ON_THE_PAGE] == list(written)
    assert set(NOT_ON_THE_PAGE) <= set(CAMPAIGNS)
    for name, section in written.items():
        assert f"`python -m campaigns.evidence {name}`" in section.splitlines()[-1]

"""The page of the campaigns: its sections and the times under them."""

from campaigns.evidence import CAMPAIGNS, written_sections


def test_every_campaign_has_its_section() -> None:
    written = written_sections()
    assert list(CAMPAIGNS) == list(written)
    for name, section in written.items():
        assert f"`python -m campaigns.evidence {name}`" in section.splitlines()[-1]

"""The pages that campaigns write: evidence with a section of each campaign, the keys and codes of the code."""

from campaigns import reference
from campaigns.evidence import CAMPAIGNS, written_sections


def test_every_campaign_has_its_section() -> None:
    written = written_sections()
    assert list(CAMPAIGNS) == list(written)
    for name, section in written.items():
        assert f"`python -m campaigns.evidence {name}`" in section.splitlines()[-1]


def test_the_committed_page_has_the_keys_and_codes_of_the_code():
    committed = reference.PAGE.read_text(encoding="utf-8")
    assert committed == reference.page(), "make it anew: python -m campaigns.reference"

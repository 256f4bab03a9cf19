"""The page of keys and codes is the one that the code makes."""

from campaigns.reference import PAGE, page


def test_the_committed_page_has_the_keys_and_codes_of_the_code():
    assert PAGE.read_text(encoding="utf-8") == page(), "make it anew: python -m campaigns.reference"

"""The pages that campaigns write: evidence by campaign, keys and codes of the code, licences of what is imported."""

import re

from campaigns import evidence, licences, reference
from campaigns.evidence import CAMPAIGNS, written_sections


def test_every_campaign_has_its_section_and_says_what_made_it() -> None:
    written = written_sections()
    assert list(CAMPAIGNS) == list(written)
    for name, section in written.items():
        origin = section.splitlines()[-1]
        assert f"`python -m campaigns.evidence {name}`" in origin
        assert re.search(r"Made at \w{8}; depends on [a-z, ]+\.|has not been run", origin)


def test_stale_sections_are_marked_once_and_the_mark_goes(tmp_path, monkeypatch, capsys) -> None:
    page = tmp_path / "evidence.md"
    page.write_text(evidence.PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.setattr(evidence, "PAGE", page)
    for goldens in (["spin", "new"], ["spin", "new"], []):
        monkeypatch.setattr(evidence, "changed", lambda _, goldens=goldens: goldens)
        evidence.mark_stale()
        assert written_sections()["spin"].count("other results since then of `spin`.\n") == bool(goldens)
    assert "spin: spin\n" in capsys.readouterr().out
    assert "Stale**" not in page.read_text(encoding="utf-8")
    assert list(written_sections()) == list(CAMPAIGNS)


def test_the_committed_page_has_the_keys_and_codes_of_the_code():
    committed = reference.PAGE.read_text(encoding="utf-8")
    assert committed == reference.page(), "make it anew: python -m campaigns.reference"


def test_the_committed_page_has_every_package_that_is_imported_and_its_option():
    _, *stated = re.findall(
        r"^\| (\S+) \| (\S+) \| \S+ \| .+ \|$", licences.PAGE.read_text(encoding="utf-8"), re.MULTILINE
    )
    wanted = [(one.name, one.option) for one in licences.imported()]
    assert stated == wanted, "make it anew: python -m campaigns.licences"
    assert {"casadi", "unicorn"} <= {one.name for one in licences.imported() if one.apart}

"""Clocks and dialects of other people's logs are read, or refused by what helps; their sound twins are read."""

import pytest

from tests.support.foreign_tables import KINDS, outcome, pair_of


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", KINDS)
def test_file_of_a_kind_and_its_twin_are_read(tmp_path, kind, seed):
    file, twin = pair_of(kind, seed)
    result, words = outcome(file, tmp_path / "run.csv")
    assert (result, file.refusal in words) == ("refused" if file.refusal else "right", True), words
    assert outcome(twin, tmp_path / "twin.csv") == ("right", "")

"""A sample of the campaign that fuzzes the link: each layer lets pass what chance lets it, and nothing is acted on."""

import pytest

from ballbot.firmware.host import compilers
from campaigns.link_fuzz import Kind, rows

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")


@pytest.mark.sample
def test_layers_let_pass_what_chance_lets_them():
    table, found = rows(1_000_000, seed=2)
    by_name = {one.name: one for one in table}
    assert {one.name: one.passed for one in table if not one.is_likely} == {}
    assert by_name["framing"].passed > 0
    assert by_name["version"].passed > 3
    for name in ("checksum", "session", "all layers, changed frames", "all layers, random bytes"):
        assert by_name[name].passed == 0
    assert sum(int(one["acted"]) for one in found.values()) == 0
    assert sum(int(one["bytes"]) for one in found.values()) >= 1_000_000
    assert found[Kind.CHANGED]["same"] > 0

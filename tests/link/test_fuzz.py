"""A sample of the campaign that fuzzes the link: each layer lets pass what chance lets it, and nothing is acted on."""

import subprocess
from pathlib import Path

import pytest

from ballbot.errors import InputError
from ballbot.firmware.build import compile_sources, compilers, source_files
from campaigns.link_fuzz import Kind, rows
from tests.link.test_emulated import parameters

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


@pytest.mark.board
def test_sanitizers_find_nothing_in_the_link(tmp_path):
    program = tmp_path / "fuzz"
    flags = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    try:
        compile_sources(program, [*source_files(), Path(__file__).parent / "fuzz.c"], flags=flags)
    except InputError as refusal:
        pytest.skip(f"the compiler has no sanitizers: {str(refusal)[:200]}")
    done = subprocess.run([program], input=parameters().tobytes(), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()[:3000]

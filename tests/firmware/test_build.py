"""Compiled files are kept in the user's cache folder, by a digest of all that they follow from."""

import sys

import pytest

from ballbot.firmware.build import kept_build

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the cache folder is set by XDG_CACHE_HOME")


def kept(parts, made):
    """Return the file that is kept for these parts; it is listed in `made` if it is built anew."""

    def build(path):
        path.write_text("built")
        made.append(path)

    return kept_build("robot.so", parts, build)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "ballbot"


def test_same_parts_are_built_once(folder):
    first = kept(["gcc", b"int x;"], made := [])
    assert kept(["gcc", b"int x;"], made) == first
    assert len(made) == 1
    assert first.parent == folder
    assert [path.name for path in folder.iterdir()] == [first.name]  # nothing half-made stays
    assert folder.stat().st_mode & 0o077 == 0  # what is loaded from here, only its user can write


@pytest.mark.parametrize(
    "parts", [["clang", b"int x;"], ["gcc", b"int y;"], ["gccint", b" x;"], ["gcc", b"int x;", b""]]
)
@pytest.mark.usefixtures("folder")
def test_other_parts_are_another_build(parts):
    assert kept(["gcc", b"int x;"], []) != kept(parts, made := [])
    assert made


def test_folder_that_cannot_be_written_is_no_error(folder):
    folder.parent.write_text("")  # a file in its place
    found = kept(["gcc"], [])
    assert found.read_text() == "built"
    assert folder not in found.parents

"""Every kind of wrong file ends in one clear sentence on standard error and exit code 2, never a traceback."""

import tempfile

import pytest

from ballbot import InputError
from ballbot.cli.main import main
from ballbot.files import check_folder

GOOD_LOG = "t,u1,u2,u3,theta\n" + "".join(f"{k * 0.005:g},0.1,0,0,{0.001 * k:g}\n" for k in range(50))


def sentence_of(capsys, *arguments: str) -> str:
    """Run the command, check its exit code, and return its text on standard error."""
    assert main(list(arguments)) == 2
    printed = capsys.readouterr().err.strip()
    assert printed.startswith("ballbot: ")
    assert len(printed.splitlines()) == 1
    assert "Traceback" not in printed
    return printed


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "empty"),
        ("t,u1\n0,1\n1\n2,1\n", "line 3"),
        ("t,u1\n0,1\n1,1\n0.5,1\n", "t"),
    ],
)
@pytest.mark.parametrize(
    "command", ["check-log", "study", "identify", "identify-driveline", "identify-upside-down", "validate"]
)
def test_file_that_is_not_a_log_is_refused(tmp_path, capsys, command, content, words):
    path = tmp_path / "log.csv"
    path.write_text(content)
    before = {"check-log": [], "validate": ["rezero"]}.get(command, ["alten"])
    after = [] if command == "check-log" else ["--out", str(tmp_path / "out")]
    printed = sentence_of(capsys, command, *before, str(path), *after)
    assert "log.csv" in printed
    assert words in printed
    assert not (tmp_path / "out").exists() or not any((tmp_path / "out").iterdir())


@pytest.mark.parametrize("content", ["", "gain = [", "gain = [[1, 2], [3]]\n", 'gain = "soft"\n'])
def test_file_that_is_not_a_controller_is_refused(tmp_path, capsys, content):
    path = tmp_path / "controller.toml"
    path.write_text(content)
    out = ["--out", str(tmp_path / "out")]
    for command in (["simulate", "alten"], ["record", "nominal"]):
        printed = sentence_of(capsys, *command, "--controller", str(path), *out)
        assert "controller.toml" in printed
    assert "controller.toml" in sentence_of(capsys, "compare", "alten", str(path), *out)


def test_a_folder_that_cannot_be_written_into_is_refused_before_the_work(tmp_path, monkeypatch):
    def full(**_: object) -> None:
        raise OSError(28, "No space left on device")

    assert check_folder(tmp_path / "new") == tmp_path / "new"
    assert list((tmp_path / "new").iterdir()) == []
    # root may write anywhere, so that no mode forbids it
    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    with pytest.raises(InputError, match=r"Nothing can be written into .*: No space left on device"):
        check_folder(tmp_path)

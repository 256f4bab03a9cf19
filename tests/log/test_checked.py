"""Every analysis checks its logs before it works: an error stops it, --accept goes on, and reports show findings."""

import json

import pytest

import ballbot
from ballbot import Log
from ballbot.cli.main import main
from ballbot.errors import InputError
from ballbot.identification import identify
from tests.support.identification_examples import alten, balancing_log, noisy
from tests.support.validation_examples import true_robot


@pytest.fixture(scope="module")
def good() -> Log:
    return noisy(balancing_log(), seed=6).between(6.0, 8.5).without_truth()


@pytest.fixture(scope="module")
def bad(good) -> Log:
    """Return a log whose lean rate has the wrong sign."""
    return good.with_columns({"phi_dot": -good["phi_dot"]})


@pytest.fixture
def bad_file(tmp_path, bad):
    path = tmp_path / "my runs" / "bad.csv"
    path.parent.mkdir()
    bad.write(path)
    return path


@pytest.mark.parametrize("command", ["study", "identify", "validate", "align", "spin"])
def test_error_in_a_log_stops_a_command_with_one_sentence_and_no_folder(tmp_path, bad_file, capsys, command):
    out = tmp_path / "out"
    words = {
        "align": [str(bad_file), str(bad_file)],
        "spin": ["none.mp4", "--log", str(bad_file), "--robot", "alten"],
        "validate": ["alten", str(bad_file), "--against", "thesis"],
    }.get(command, ["alten", str(bad_file)])
    assert main([command, *words, "--out", str(out)]) == 2
    shown = capsys.readouterr()
    assert shown.err.startswith(f"ballbot: {bad_file}: ")
    assert "--accept sign" in shown.err
    assert shown.err.count("\n") == 1
    assert not shown.out
    assert not out.exists()


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_validate_goes_on_and_shows_what_was_accepted(tmp_path, bad_file, capsys):
    out = tmp_path / "out"
    words = ["validate", "alten", str(bad_file), "--against", "thesis", "--out", str(out)]
    assert main([*words, "--accept", "sign", "--accept", "gap"]) == 0
    results = json.loads((out / "results.json").read_text())
    accepted = [one for one in results["findings"] if one["severity"] == "error"]
    assert {one["code"] for one in accepted} == {"sign"}
    assert accepted[0]["where"]["file"] == str(bad_file)
    assert "--accept sign --accept gap" in results["provenance"]["command"]
    page = (out / "report.html").read_text()
    assert "accepted" in page
    assert "bad.csv" in page
    assert "error (accepted): " in capsys.readouterr().out


def test_python_functions_check_their_logs(good, bad):
    with pytest.raises(InputError, match=r"accept=\['sign'\]"):
        ballbot.identify(alten(), bad)
    with pytest.raises(InputError, match=r"^log 2: .*accept=\['sign'\]"):
        identify(alten(), [good, bad])
    with pytest.raises(InputError, match=r"accept=\['sign'\]"):
        ballbot.validate(true_robot(), bad)
    with pytest.raises(InputError, match=r"^bad: .*accept=\['sign'\]"):
        ballbot.study(alten(), {"good": good, "bad": bad})

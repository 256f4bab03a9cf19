"""`ballbot demo`: the recorded runs that ship with it, their file, the page, what the page shows of the friction."""

import json

import numpy as np
import pytest

from ballbot.cli.main import main
from ballbot.fitting.run import Run
from ballbot.log import Log
from ballbot.report import demo
from ballbot.report.blocks import Result
from ballbot.report.page import render
from ballbot.robot import Robot
from ballbot.twin.scenario import Scenario
from ballbot.workflows.metrics import position_error
from tests.support.report_pages import LARGEST_PAGE


@pytest.fixture(scope="module")
def runs() -> dict[str, Log]:
    return demo.read_runs()


def test_soft_gain_wanders_and_precise_controller_stays(runs):
    errors = {name: position_error(log) for name, log in runs.items()}
    # settled on the first 8 s, in which the reference does not move: the last 2 s before the first corner
    settled = (runs[demo.SOFT].t > 6.0) & (runs[demo.SOFT].t < 7.9)
    assert errors[demo.SOFT][settled].min() > 0.1
    assert errors[demo.PRECISE][settled].max() < 0.01


@pytest.mark.sample
def test_friction_found_is_near_the_simulated_robots_and_has_a_report(runs, tmp_path):
    found = demo.friction_report(runs[demo.SOFT], Run())
    render(found, tmp_path)
    assert len((tmp_path / "report.html").read_text(encoding="utf-8")) < LARGEST_PAGE
    results = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    true = Scenario.nominal(Robot.load(demo.ROBOT)).friction.coulomb
    # 20 s of log, too short to find the rollers: what they and the play of 1 degree take is in c, 0.29 to 0.44 of it
    np.testing.assert_allclose(results["parameters"]["c"], true, rtol=0.6)


def test_page_is_there_before_the_friction_is_identified(tmp_path, monkeypatch, capsys):
    seen = {}

    def stop(*_: object) -> None:
        seen["page"] = (tmp_path / "demo.html").read_text(encoding="utf-8")
        raise KeyboardInterrupt

    monkeypatch.setattr("ballbot.cli.demo.friction_report", stop)
    assert main(["demo", "--no-browser", "--out", str(tmp_path)]) == 130
    assert demo.PRECISE in seen["page"]
    assert "up to 373 mm off, the precise controller 6.4 mm" in seen["page"]  # as campaigns.demo_runs prints
    printed = capsys.readouterr()
    assert "demo.html" in printed.out
    assert printed.err.splitlines()[-1].startswith("ballbot: interrupted")


@pytest.mark.parametrize("there", [True, False])
def test_live_view_is_to_be_installed_only_where_it_is_not(tmp_path, monkeypatch, capsys, there):
    found = Result(title="found", lead="", verdict=[("", "yes")], sections=[], undecided=[])
    monkeypatch.setattr("ballbot.cli.demo.friction_report", lambda *_: found)
    monkeypatch.setattr("ballbot.cli.demo.find_spec", lambda _: there or None)
    assert main(["demo", "--no-browser", "--out", str(tmp_path)]) == 0
    assert ("pip install 'ballbot[view]'" in capsys.readouterr().out) == (not there)

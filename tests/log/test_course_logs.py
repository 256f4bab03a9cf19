"""The course robots' own logs: what `check-log` must find in them."""

import json
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from ballbot.cli.check_log import check_log
from ballbot.findings import Finding
from ballbot.log import Log
from ballbot.log.mapping_inference.proposal import Proposal, propose
from ballbot.log.mapping_inference.report import findings_of
from ballbot.robot import Robot

#: where wheel 1 stands against the IMU's x axis [deg], with the wheels counting as heading says: the course puts its
#: first wheel on the y axis (lab10); the other team's controller mixes its commands for wheels at 120, 240 and 0
FIRST_WHEEL = {"main_control_1": 120.0, "main_control_autotune_1": 120.0, "lab10_data_trial_408": 90.0}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.load("rob311")


@pytest.fixture(scope="module")
def proposal_of(shared_data, robot) -> Callable[[str], Proposal]:
    """Return what proposes the mapping of a log by its name, each once."""
    return cache(lambda name: propose(shared_data / "rob311" / f"{name}.txt", robot))


@pytest.mark.sample
@pytest.mark.parametrize("name", FIRST_WHEEL)
def test_handedness_phase_and_timing(proposal_of, robot, name):
    proposal = proposal_of(name)
    tested = proposal.lean_test
    assert tested is not None
    assert not tested.placements[0].mirrored
    assert tested.placements[0].reversed_wheels == ()
    assert tested.margin > 2.0
    first = np.degrees(robot.wheels.azimuths[0] - proposal.frame.measured_turn)
    assert abs((first - FIRST_WHEEL[name] + 180.0) % 360.0 - 180.0) < 5.0
    assert proposal.frame.signs == (-1, -1, -1)
    assert proposal.frame.signs_by_heading
    # the lean answers as much as the robot file's radii, masses and the recognised units say
    assert 0.5 < tested.placements[0].gain < 2.0
    assert proposal.timing.after is not None
    assert proposal.timing.after <= 0.25
    # the trial's: sensor 16 to 20 ms, command 9 to 14 ms, of which half a message's interval depends on the clock
    assert 0.014 < tested.lag < 0.022
    assert proposal.commands is not None
    assert proposal.commands.order == (1, 2, 3)
    assert 0.0065 < proposal.commands.delay < 0.0165
    kinds = {finding.code for finding in findings_of(proposal)}
    assert {"disturbance", "fall", "timing"} <= kinds


@pytest.mark.parametrize(
    "name",
    [
        "main_control_autotune_1",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("main_control_1", "lab10_data_trial_408")),
    ],
)
def test_the_controllers_own_mixing_agrees(proposal_of, robot, name):
    """A robot that balances pushes its ball after the lean; so its own commands show where its wheels are.

    Positive lean Theta asks for a ball torque along Theta. A wheel at azimuth beta gives a torque -(cos beta, sin beta)
    for a positive command that turns it forward.
    """
    proposal = proposal_of(name)
    signals, tested, commands = proposal.signals, proposal.lean_test, proposal.commands
    assert tested is not None
    assert commands is not None
    assert signals.lean is not None
    assert signals.commands is not None
    lean = signals.lean.value[:, 0] + 1j * signals.lean.value[:, 1]
    turn = -proposal.frame.measured_turn
    beta = np.asarray(robot.wheels.azimuths) + turn
    forward = signals.commands * np.asarray(commands.signs)
    torque = -forward @ np.exp(1j * beta)
    rows = tested.balancing
    centred = lean[rows] - lean[rows].mean()
    gain = np.vdot(centred, torque[rows]) / np.vdot(centred, centred)
    # the commands lag and have integral and derivative parts, which leave the direction alone
    assert abs(np.angle(gain)) < np.radians(20.0)


def test_free_wheel_sweep_is_recognised(shared_data, robot):
    proposal = propose(shared_data / "rob311" / "Test-Results_test_motors_1.txt", robot)
    assert proposal.lean_test is None
    assert proposal.wheel.unit == "counts"
    assert proposal.commands is not None
    assert set(proposal.commands.signs) == {1}
    told = " ".join(finding.text for finding in findings_of(proposal))
    assert "drivelines only" in told
    # -5 ms, where the search ends, has no standard error
    assert "Commands are logged" not in told
    assert "Torque constant and winding resistance are assumed" in told


def test_glitches_in_logged_speeds_are_found(proposal_of):
    found = findings_of(proposal_of("main_control_autotune_1"))
    assert [f for f in found if isinstance(f, Finding) and f.code == "glitch"]


@pytest.mark.sample
def test_the_command_writes_a_log_that_identification_can_use(shared_data, tmp_path, capsys):
    check_log(shared_data / "rob311" / "main_control_1.txt", robot="rob311", dead_band=0.06, out=tmp_path)
    shown = capsys.readouterr().out
    assert "as the robot's" in shown
    assert "mapping.toml" in shown
    log = Log.read(tmp_path / "log.csv")
    log.require("t", "u1", "u2", "u3", "x", "y", "theta", "phi", "psi", "wheel1_dot")
    assert log.sample_time == pytest.approx(0.01)
    # rows by the mapping alone are those of the log written
    again = Log.read(shared_data / "rob311" / "main_control_1.txt", mapping=tmp_path / "mapping.toml")
    np.testing.assert_allclose(again["theta"], log["theta"])
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["handedness"] == "direct"
    assert abs(results["phase_deg"] + 150.0) < 5.0

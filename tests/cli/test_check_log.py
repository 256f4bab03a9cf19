"""`ballbot check-log` on a log of angles without their rates."""

import pytest

from ballbot.cli.main import main
from ballbot.log import Log
from ballbot.robot.file import robot_text
from tests.support.foreign_log_examples import small_robot, swaying_log


@pytest.mark.parametrize(
    ("renamed", "sign", "shown"),
    [
        ({}, 1.0, "By angles and wheels: theta_dot, phi_dot"),
        ({"theta": "phi", "phi": "theta"}, 1.0, "theta and phi are swapped"),
        ({"wheel1": "wheel2", "wheel2": "wheel1"}, 1.0, "The lean does not fit the ball's acceleration"),
        ({}, -1.0, "have the opposite sign"),
    ],
)
def test_a_log_of_angles_alone_is_checked_with_their_rates(tmp_path, capsys, renamed, sign, shown):
    """Its names are Ballbot's, but what they mean is a claim until the robot's equations confirm it."""
    robot = tmp_path / "robot.toml"
    robot.write_text(robot_text(small_robot()))
    log = swaying_log()
    angles = ("theta", "phi", "psi", "wheel1", "wheel2", "wheel3")
    columns = {renamed.get(name, name): log[name] for name in ("t", *angles)}
    Log(columns | {name: sign * log[name] for name in ("u1", "u2", "u3")}).write(tmp_path / "log.csv")
    code = main(["check-log", str(tmp_path / "log.csv"), "--robot", str(robot)])
    assert shown in " ".join(capsys.readouterr().out.split())
    assert code == (0 if shown.startswith("By") else 2)

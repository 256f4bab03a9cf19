"""Inputs that no command of Ballbot makes: records of other plants, foreign files and a video, from fixed seeds."""

import csv
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.geometry import transforms
from ballbot.robot import Robot


def axis_record(folder: Path) -> None:
    """Write record.csv: 9 s at 1 kHz of a sliding mass, 95 kg with dry friction, that a loop moves.

    Columns t [s], position [m], force [N] and aim, the reference [m]. A disturbance of the force, N(0, 2) [N] held
    for 50 ms, is not in the record.
    """
    h, mass, viscous, coulomb = 1e-3, 95.0, 200.0, 20.0
    t = np.arange(9000) * h
    aim = 0.1 * (1.0 - np.cos(2.0 * np.pi * t / 3.0)) + 0.02 * np.sin(2.0 * np.pi * t / 0.7)
    disturbance = np.repeat(2.0 * np.random.default_rng(5).standard_normal(len(t) // 50), 50)
    position, speed = np.zeros(len(t)), 0.02 * 2.0 * math.pi / 0.7
    force = np.zeros(len(t))
    for k in range(len(t)):
        force[k] = 243.0 * 35.0 * (160.0 * (aim[k] - position[k]) - speed)
        if k + 1 < len(t):
            friction = viscous * speed + coulomb * math.tanh(speed / 1e-3) - 3.0
            speed += h * (force[k] + disturbance[k] - friction) / mass
            position[k + 1] = position[k] + h * speed
    _write_csv(folder / "record.csv", {"t": t, "position": position, "force": force, "aim": aim})


def swing(folder: Path) -> None:
    """Write swing.csv: 15 s at 50 Hz of theta [rad] of a body that hangs from the ball's centre and swings freely.

    Inertia about the pivot 4.37 kg m^2, viscous damping; noise of the angle N(0, 0.0005) [rad].
    """
    h, stiffness, damping = 1e-3, 17.076 * 9.81 * 0.393 / 4.37, 0.02
    angle, rate, angles = 0.2, 0.0, []
    for k in range(15000):
        if k % 20 == 0:
            angles.append(angle)
        rate += h * (-stiffness * math.sin(angle) - damping * rate)
        angle += h * rate
    noise = 5e-4 * np.random.default_rng(6).standard_normal(len(angles))
    columns = {"t": 0.02 * np.arange(len(angles)), "theta": math.pi + np.array(angles) + noise}
    _write_csv(folder / "swing.csv", columns)


def foreign_log(folder: Path) -> None:
    """Write log.csv: the log of record_square in degrees, with other names, signs and order of wheels.

    robot.toml is its robot, with the resistance of motors whose full duty at standstill gives the torque limit.
    """
    robot = Robot.load("alten")
    robot.replace(drive=replace(robot.drive, resistance=3.4776)).write(folder / "robot.toml")
    with (folder.parent / "record_square/log.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    degree = 180.0 / math.pi
    theirs = ["t_now", "u1", "u2", "u3", "theta_x", "theta_y", "theta_z", "psi_1", "psi_2", "psi_3"]
    ours = ["t", "u2", "u3", "u1", "theta", "phi", "psi", "wheel2", "wheel3", "wheel1"]
    factors = (*(1.0,) * 4, degree, -degree, degree, *(-1.0,) * 3)
    columns = {
        new: np.array([factor * float(row[old]) for row in rows])
        for new, old, factor in zip(theirs, ours, factors, strict=True)
    }
    _write_csv(folder / "log.csv", columns)


def video(folder: Path) -> None:
    """Write ball.avi, 5 s of a turning ball, 200 x 160 pixels without loss, and log.csv, the wheels that turn it."""
    from tests.support.ball_video import Camera, Scene, render, wandering, write_video

    camera = Camera(size=(200, 160), centre=(104.0, 77.0), radius=66.0, frame_rate=30.0)
    scene = Scene(camera=camera)
    motion = wandering(duration=5.0, peak=10.0, seed=3)
    t = np.arange(0.0, 5.0, 0.005)
    speeds = motion.omega_at(t) @ transforms(Robot.load("alten")).T_owb.T
    _write_csv(folder / "log.csv", {"t": t, **{f"wheel{i + 1}_dot": speeds[:, i] for i in range(3)}})
    frames = render(scene, motion, duration=5.0)
    write_video(folder / "ball.avi", frames, frame_rate=camera.frame_rate, codec="HFYU")


def _write_csv(path: Path, columns: Mapping[str, NDArray[np.floating]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))

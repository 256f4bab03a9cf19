"""Write records to try a page of the documentation with: of a slide, of a body that swings, of a ball on film.

python examples/07_sample_records.py axis axis.csv
python examples/07_sample_records.py swing hanging.csv
python examples/07_sample_records.py ball upside_down/log.csv upside_down.mp4

The last one films the ball of a recording that `ballbot record nominal --experiment upside_down` made.
"""

import math
import sys

import numpy as np

from ballbot import Log, Robot


def write(path: str, columns: dict[str, np.ndarray]) -> None:
    """Write columns as a CSV file."""
    np.savetxt(
        path, np.column_stack(list(columns.values())), "%.7g", ",", header=",".join(columns), comments=""
    )


def axis(path: str) -> None:
    """Write 9 s at 1 kHz of a slide of 95 kg that a controller moves: t [s], position and reference [m], force [N].

    Friction 200 N s/m and 20 N; a force N(0, 2) [N], constant for 50 ms at a time, disturbs it and is not in the file.
    """
    h, mass, viscous, coulomb = 1e-3, 95.0, 200.0, 20.0
    t = h * np.arange(9000)
    reference = 0.1 * (1.0 - np.cos(2.0 * np.pi * t / 3.0)) + 0.02 * np.sin(2.0 * np.pi * t / 0.7)
    disturbance = np.repeat(2.0 * np.random.default_rng(5).standard_normal(180), 50)
    position, force, x, v = np.zeros(9000), np.zeros(9000), 0.0, 0.02 * 2.0 * math.pi / 0.7
    for k in range(9000):
        position[k] = x
        force[k] = 8505.0 * (160.0 * (reference[k] - x) - v)
        v += h * (force[k] + disturbance[k] - viscous * v - coulomb * math.tanh(v / 1e-3)) / mass
        x += h * v
    write(path, {"t": t, "position": position, "force": force, "reference": reference})


def swing(path: str) -> None:
    """Write 15 s at 50 Hz of the thesis's body, hung up at the ball's centre: t [s] and theta [rad].

    Its inertia about the pivot is 4.37 kg m^2; viscous damping; noise of the angle N(0, 0.0005) [rad].
    """
    body = Robot.load("alten").body
    h, stiffness = 1e-3, body.mass * 9.81 * body.center_of_mass / 4.37
    angle, rate, angles = 0.2, 0.0, []
    for k in range(15000):
        if k % 20 == 0:
            angles.append(math.pi + angle)
        rate += h * (-stiffness * math.sin(angle) - 0.02 * rate)
        angle += h * rate
    noise = 5e-4 * np.random.default_rng(6).standard_normal(len(angles))
    write(path, {"t": 0.02 * np.arange(len(angles)), "theta": np.array(angles) + noise})


def ball(recording: str, path: str) -> None:
    """Draw 12 s of a recording's ball from its third second on; the robot's x points 30 degrees clockwise.

    No light or shadow; noise of each pixel N(0, 1) [grey levels].
    """
    import cv2
    from scipy.spatial.transform import Rotation

    from ballbot.vision.seam import seam_table, thesis_seam
    from ballbot.vision.view import View

    log, rate, size, random = Log.read(recording), 60.0, (240, 180), np.random.default_rng(7)
    view = View(x=124.0, y=87.0, radius=76.0, closeness=1.0 / 7.0, middle=(119.5, 89.5))
    places = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2)
    points, facing = view.points(places.astype(float))
    on_ball = np.isfinite(facing)
    table, seam, ball = (
        seam_table(thesis_seam()),
        np.array([40.0, 190.0, 225.0]),
        np.array([92.0, 70.0, 62.0]),
    )
    # the robot stands on its head: its z points away from the camera, which looks down
    turn, R = Rotation.from_euler("z", 30.0, degrees=True), Rotation.identity()
    video = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*"mp4v"), rate, size)
    for frame in range(round(12.0 * rate)):
        picture = np.full((len(places), 3), 150.0)
        q = R.inv().apply(points[on_ball])
        distance = np.arcsin(np.abs(np.sum(table.normals_at(q.astype(np.float32)) * q, axis=1)))
        # half the seam's width is 0.035 ball radii; an edge is as wide as a pixel
        cover = np.clip((0.035 - distance) * view.radius + 0.5, 0.0, 1.0)[:, None]
        picture[on_ball] = (ball + cover * (seam - ball)) * (0.5 + 0.5 * facing[on_ball])[:, None]
        picture = cv2.GaussianBlur(picture.reshape(size[1], size[0], 3), (0, 0), 0.6)
        picture += random.standard_normal(picture.shape)
        video.write(np.clip(picture, 0.0, 255.0).astype(np.uint8))
        for t in 3.0 + (frame + np.arange(0.05, 1.0, 0.1)) / rate:
            omega = [np.interp(t, log.t, log[f"ball_omega_{axis}"]) for axis in "xyz"]
            R = Rotation.from_rotvec(turn.apply(omega) * 0.1 / rate) * R
    video.release()


{"axis": axis, "swing": swing, "ball": ball}[sys.argv[1]](*sys.argv[2:])
print(f"{sys.argv[-1]} is written")

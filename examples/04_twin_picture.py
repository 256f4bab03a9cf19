"""Friction compensation on the twin as a picture: the one in the README.

    make demo
    python examples/04_twin_picture.py demo/robot.toml docs/images/compensation.svg

The robot file holds the friction that the demo's study identified from recorded logs.
"""

import sys

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

import ballbot
from ballbot.control.nominal import design_gain
from ballbot.control.references import square
from ballbot.experiments.score import score
from ballbot.twin import Twin

mpl.rcParams["svg.hashsalt"] = "ballbot"  # the same picture, the same bytes

robot_path, picture_path = sys.argv[1], sys.argv[2]
robot = ballbot.Robot.load(robot_path)
gain = design_gain(robot).gain
figure = Figure(figsize=(9.0, 3.4), layout="constrained")
panels = figure.subplots(1, 2, sharex=True, sharey=True)
titles = {"none": "without compensation", "partial": "identified friction compensated"}
for axes, (compensation, title) in zip(panels, titles.items(), strict=True):
    controller = ballbot.Controller(robot, gain, compensation=compensation)
    log = ballbot.simulate(Twin(robot), controller, square(side=0.5, period=32.0), duration=72.0, seed=7)
    truth, peak = log.truth(), score(log).peak_position_error
    axes.plot(
        log["ref_x"], log["ref_y"], color="0.6", linewidth=4, solid_joinstyle="miter", label="reference"
    )
    axes.plot(truth["x"], truth["y"], color="#1b5e9e", linewidth=1.1, label="ball")
    axes.set_title(f"{title}: {100 * peak:.0f} cm at most", fontsize=10)
    axes.set_xlabel("x [m]")
    axes.set_aspect("equal")
    axes.grid(color="0.92")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
panels[0].set_ylabel("y [m]")
panels[0].legend(frameon=False, loc="upper left", fontsize=8)
panels[0].set_xticks(np.arange(-0.5, 1.1, 0.5))
figure.savefig(picture_path, metadata={"Date": None})

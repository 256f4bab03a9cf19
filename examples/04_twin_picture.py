"""Draw the controller that a study chose on the twin: the picture in the README.

    make demo
    python examples/04_twin_picture.py demo docs/images/square_on_twin.svg

The folder is that of a study, with the identified robot and the chosen controller. The script takes half a minute.
"""

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

import ballbot
from ballbot.control.file import read_controller
from ballbot.control.presets import nominal_controller
from ballbot.control.references import square
from ballbot.estimation import named_estimator
from ballbot.twin import Twin
from ballbot.workflows.metrics import score

mpl.rcParams["svg.hashsalt"] = "ballbot"  # the same picture, the same bytes

study, picture_path = Path(sys.argv[1]), sys.argv[2]
robot = ballbot.Robot.load(study / "robot.toml")
controllers = {
    "soft gain as in the thesis": nominal_controller(robot),
    "controller chosen by study": read_controller(study / "controller.toml", robot),
}
figure = Figure(figsize=(9.0, 3.4), layout="constrained")
panels = figure.subplots(1, 2, sharex=True, sharey=True)
for axes, (title, controller) in zip(panels, controllers.items(), strict=True):
    estimator = named_estimator(controller.estimator, robot, sample_time=controller.sample_time)
    twin = Twin(robot, estimator=estimator)
    log = ballbot.simulate(twin, controller, square(side=0.5, period=32.0), duration=72.0, seed=7)
    truth, peak = log.truth(), score(log).peak_position_error
    axes.plot(
        log["ref_x"], log["ref_y"], color="0.6", linewidth=4, solid_joinstyle="miter", label="reference"
    )
    axes.plot(truth["x"], truth["y"], color="#1b5e9e", linewidth=1.1, label="ball")
    axes.set_title(f"{title}: off by at most {1e3 * peak:.0f} mm", fontsize=10)
    axes.set_xlabel("x [m]")
    axes.set_aspect("equal")
    axes.grid(color="0.92")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
panels[0].set_ylabel("y [m]")
panels[0].legend(frameon=False, loc="upper left", fontsize=8)
panels[0].set_xticks(np.arange(-0.5, 1.1, 0.5))
figure.savefig(picture_path, metadata={"Date": None})

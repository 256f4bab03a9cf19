"""Use a robot's equations of motion: how fast it falls, when friction holds it, and what the thesis's equations give.

python examples/01_model.py
"""

from dataclasses import replace

import numpy as np

import ballbot

robot = ballbot.Robot.load("alten")
exact, thesis = ballbot.Model(robot), ballbot.Model(robot, formulation="thesis")
print(
    f"unstable pole: {exact.linearize().poles()[0].real:.2f} rad/s exact, "
    f"{thesis.linearize().poles()[0].real:.2f} rad/s as the thesis prints it"
)

# Let it fall from 1 degree, without friction, until the lean is 30 degrees.
state, seconds = np.zeros(10), 0.0
state[2] = np.radians(1)
while state[2] < np.radians(30):
    state, seconds = exact.advance(state, np.zeros(3), 0.005), seconds + 0.005
print(f"falls from 1 to 30 degrees in {seconds:.2f} s")

# With friction it may rest: friction holds a small lean for sixty seconds without changing one bit of the state.
friction = replace(robot.friction, coulomb=(0.1, 0.1, 0.1), rolling=0.007)
sticky = ballbot.Model(robot.replace(friction=friction))
start = np.zeros(10)
start[2] = np.radians(0.1)
rests = bool((sticky.advance(start, np.zeros(3), 60.0) == start).all())
print(f"friction holds 0.1 degrees of lean for a minute, to the bit: {rests}")

"""Whether logs obey the robot's own equations: checks that take no friction and no controller.

`examine` checks one log, `different_robots` what several logs of it said.

motion             filtered motion of ball and body, all signals through one filter
delay              how late the torques answer the states
lean               lean axes against the ball's acceleration: gravity accelerates the robot towards its lean
torque             wheel torques against the torques that the motion needs: sign, order, scale
gains              how large the torques are, wheel by wheel
examine            the checks of one log, in the order in which one rests on another
different_robots   the scales of several logs against each other
"""

from ballbot.log.physics.different_robots import different_robots
from ballbot.log.physics.examine import Examined, examine

__all__ = ["Examined", "different_robots", "examine"]

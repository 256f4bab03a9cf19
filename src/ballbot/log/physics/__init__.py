"""Whether a log obeys the robot's own equations: checks that take no friction and no controller.

`physics_findings(log, robot)` holds one log, `different_robots(logs, robot)` several against each other.

motion     filtered motion of ball and body, all signals through one filter
delay      how late the torques answer the states
lean       lean axes against the ball's acceleration: gravity accelerates the robot towards its lean
torque     wheel torques against the torques that the motion needs: sign, order, scale
"""

from ballbot.log.physics.findings import physics_findings

__all__ = ["physics_findings"]

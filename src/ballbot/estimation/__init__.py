"""The state from the robot's own sensors."""

from ballbot.estimation.onboard import OnboardState

__all__ = ["OnboardState"]

"""The MuJoCo twin: a robot to experiment on, with real rollers, sensors and faults."""

from ballbot.twin.mjcf import twin_mjcf
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin

__all__ = ["Scenario", "Twin", "twin_mjcf"]

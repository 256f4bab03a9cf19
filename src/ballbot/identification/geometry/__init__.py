"""The robot's geometry from its logs, by kinematics alone: a check on the tape measure."""

from ballbot.identification.geometry.found_robot import robot_with_geometry
from ballbot.identification.geometry.remarks import geometry_remarks
from ballbot.identification.geometry.survey import Geometry, Measured, survey_geometry

__all__ = ["Geometry", "Measured", "geometry_remarks", "robot_with_geometry", "survey_geometry"]

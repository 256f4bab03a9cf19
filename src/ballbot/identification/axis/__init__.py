"""One axis with friction: a mass or inertia and its friction, identified from a record of force and position."""

from ballbot.identification.axis.identify import AxisIdentification, identify_axis
from ballbot.identification.axis.inverse import InverseFit, inverse_fit
from ballbot.identification.axis.model import AXIS_LAWS, AxisLaw
from ballbot.identification.axis.record import AxisRecord, PositionVelocityLoop

__all__ = [
    "AXIS_LAWS",
    "AxisIdentification",
    "AxisLaw",
    "AxisRecord",
    "InverseFit",
    "PositionVelocityLoop",
    "identify_axis",
    "inverse_fit",
]

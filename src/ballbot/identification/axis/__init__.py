"""One axis with friction: a mass or inertia and its friction, identified from records of force and position."""

from ballbot.identification.axis.identify import AxisOptions, identify_axis
from ballbot.identification.axis.inverse import InverseFit, inverse_fit
from ballbot.identification.axis.laws import AXIS_LAWS, AxisLaw
from ballbot.identification.axis.record import AxisRecord, KnownLoad, PositionVelocityLoop
from ballbot.identification.axis.result import AxisIdentification

__all__ = [
    "AXIS_LAWS",
    "AxisIdentification",
    "AxisLaw",
    "AxisOptions",
    "AxisRecord",
    "InverseFit",
    "KnownLoad",
    "PositionVelocityLoop",
    "identify_axis",
    "inverse_fit",
]

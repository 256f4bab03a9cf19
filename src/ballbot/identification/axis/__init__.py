"""One axis with friction: a mass or inertia and its friction, identified from records of force and position."""

from ballbot.identification.axis.identify import AxisIdentification, AxisOptions, identify_axis
from ballbot.identification.axis.model import AXIS_LAWS
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.regression import InverseFit, inverse_fit

__all__ = [
    "AXIS_LAWS",
    "AxisIdentification",
    "AxisOptions",
    "AxisRecord",
    "InverseFit",
    "identify_axis",
    "inverse_fit",
]

"""One axis with friction: a mass or inertia, its friction and what a record of force and position tells of both."""

from ballbot.identification.axis.identify import identify_axis
from ballbot.identification.axis.inverse import InverseFit, inverse_fit
from ballbot.identification.axis.laws import RUNGS, Rung
from ballbot.identification.axis.record import AxisRecord, PositionVelocityLoop
from ballbot.identification.axis.result import AxisIdentification

__all__ = [
    "RUNGS",
    "AxisIdentification",
    "AxisRecord",
    "InverseFit",
    "PositionVelocityLoop",
    "Rung",
    "identify_axis",
    "inverse_fit",
]

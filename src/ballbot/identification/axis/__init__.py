"""Identify the mass or inertia and the friction of one axis from records of force and position."""

from ballbot.identification.axis.identify import AxisIdentification, AxisOptions, identify_axis
from ballbot.identification.axis.record import AxisColumns, AxisRecord, read_axis_record, record_of_rows

__all__ = [
    "AxisColumns",
    "AxisIdentification",
    "AxisOptions",
    "AxisRecord",
    "identify_axis",
    "read_axis_record",
    "record_of_rows",
]

"""Test videos of a ball that turns in a known way: from any motion, with all that spoils real ones."""

from ballbot.vision.rendering.frames import render, view_of
from ballbot.vision.rendering.motion import Motion, motion_of, wandering
from ballbot.vision.rendering.scene import Camera, Light, Scene
from ballbot.vision.rendering.write import LOSSLESS, MOTION_JPEG, MPEG4, write_video

__all__ = [
    "LOSSLESS",
    "MOTION_JPEG",
    "MPEG4",
    "Camera",
    "Light",
    "Motion",
    "Scene",
    "motion_of",
    "render",
    "view_of",
    "wandering",
    "write_video",
]

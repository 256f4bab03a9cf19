"""What a test video shows: a ball with a seam on an upside-down robot, camera, light, and what spoils a picture."""

from __future__ import annotations

from dataclasses import dataclass, field

from ballbot.vision.seams import Seam, thesis_seam

#: red, green, blue, 0 to 255, as a picture has them
Colour = tuple[int, int, int]


@dataclass(frozen=True, kw_only=True)
class Light:
    """How the scene is lit."""

    uneven: float = 0.0  #: how much darker the far corner is, as a share of the light
    highlight: float = 0.0  #: height of the lamp's reflection on the ball, as a share of full white
    shadow: float = (
        0.0  #: share of the light that a shadow with a sharp edge takes; it moves over the ball and back
    )
    shadow_period: float = 7.0  #: of that [s]


@dataclass(frozen=True, kw_only=True)
class Camera:
    """The camera, and what it spoils."""

    size: tuple[int, int] = (480, 360)  #: width and height [pixels]
    frame_rate: float = 60.0  #: [Hz]
    distance: float = 7.0  #: from the lens to the ball's centre [ball radii]
    centre: tuple[float, float] = (246.0, 172.0)  #: of the ball in the picture [pixels]
    radius: float = 135.0  #: of the ball, as `View` has it [pixels]
    exposure: float = 0.05  #: share of the time between frames in which light is gathered: motion blur
    blur: float = 0.6  #: of the lens, standard deviation [pixels]
    noise: float = 1.0  #: standard deviation [grey levels of 255]


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A ball, its light and the camera."""

    seam: Seam = field(default_factory=thesis_seam)
    seam_width: float = 0.07  #: [ball radii]
    seam_colour: Colour = (225, 190, 40)
    ball_colour: Colour = (62, 70, 92)
    light: Light = Light()
    camera: Camera = Camera()

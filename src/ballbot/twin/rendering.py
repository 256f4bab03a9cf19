"""Pictures of a robot in MuJoCo's own rendering, from its ten states: what `render` of an environment returns."""

import math
import xml.etree.ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.mechanics.geometry import rotation
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.robot.drawing import body_shape, wheel_shapes
from ballbot.twin.engine import Engine, mujoco_module
from ballbot.twin.mjcf import add, twin_mjcf
from ballbot.twin.scenario import Scenario

#: of the camera: its distance over the robot's height, and the angles from which it looks [deg]
_DISTANCE, _AZIMUTH, _ELEVATION = 3.2, 130.0, -18.0
#: a square of the floor [m], its colours, and that of the mark where the robot should be
_SQUARE, _FLOOR, _MARK = 0.5, ("0.80 0.82 0.85", "0.72 0.75 0.79"), (0.1, 0.5, 0.25, 1.0)


_SIZE = 480  #: height and width of a frame [px]


class StateRenderer:
    """Draws states of a robot on a level floor, as a camera sees it that goes with the robot.

    Parameters
    ----------
    robot : Robot, preset or robot file

    Raises
    ------
    InputError
        If MuJoCo is not installed, or finds no OpenGL to draw with.

    Examples
    --------
    >>> StateRenderer("alten").frame(np.zeros(10), np.zeros(10)).shape  # doctest: +SKIP
    (480, 480, 3)
    """

    def __init__(self, robot: RobotLike) -> None:
        robot, self._mujoco = as_robot(robot), mujoco_module()
        self._engine = Engine(_document(robot))
        self._radius, self._top = robot.ball.radius, body_shape(robot.body).top
        self._camera = self._mujoco.MjvCamera()  # pyright: ignore[reportAttributeAccessIssue]
        self._camera.azimuth, self._camera.elevation = _AZIMUTH, _ELEVATION
        self._camera.distance = _DISTANCE * (self._radius + self._top)
        refused = (AttributeError, ImportError, RuntimeError, self._mujoco.FatalError)  # pyright: ignore[reportAttributeAccessIssue]
        try:
            self._renderer = self._mujoco.Renderer(self._engine.model, _SIZE, _SIZE)
        except refused:
            raise InputError(
                "MuJoCo finds no OpenGL to draw with. On a computer without a screen, set the environment variable "
                "MUJOCO_GL to egl (Debian: apt-get install libegl1) or to osmesa (apt-get install libosmesa6)."
            ) from None

    def frame(self, state: Floats, reference: Floats) -> NDArray[np.uint8]:
        """Return the picture (480, 480, 3) of a state (10,), with a mark at the place of a reference (10,)."""
        self._place(state)
        self._camera.lookat[:] = *state[:2].tolist(), 0.5 * (self._radius + self._top)
        self._renderer.update_scene(self._engine.data, self._camera)
        self._mark(reference)
        return self._renderer.render()

    def close(self) -> None:
        """Free what MuJoCo draws with."""
        self._renderer.close()

    def _place(self, state: Floats) -> None:
        (x, y), engine, mujoco = state[:2].tolist(), self._engine, self._mujoco
        ball, body = engine.position("ball"), engine.position("body")
        ball[:3] = body[:3] = x, y, self._radius
        mujoco.mju_mat2Quat(body[3:], rotation(*state[2:5].tolist()).ravel())  # pyright: ignore[reportAttributeAccessIssue]
        # as if the ball had rolled there from the origin along the straight line
        way = math.hypot(x, y)
        axis = np.array([-y, x, 0.0]) / way if way else np.array([0.0, 0.0, 1.0])
        mujoco.mju_axisAngle2Quat(ball[3:], axis, way / self._radius)  # pyright: ignore[reportAttributeAccessIssue]
        mujoco.mj_forward(engine.model, engine.data)  # pyright: ignore[reportAttributeAccessIssue]

    def _mark(self, reference: Floats) -> None:
        scene, (x, y) = self._renderer.scene, reference[:2].tolist()
        kind = self._mujoco.mjtGeom.mjGEOM_CYLINDER  # pyright: ignore[reportAttributeAccessIssue]
        initialize = self._mujoco.mjv_initGeom  # pyright: ignore[reportAttributeAccessIssue]
        size, middle = np.array([0.5 * self._radius, 1e-3, 0.0]), np.array([x, y, 1e-3])
        turn, color = np.eye(3).ravel(), np.array(_MARK, np.float32)
        initialize(scene.geoms[scene.ngeom], kind, size, middle, turn, color)
        scene.ngeom += 1


def _document(robot: Robot) -> str:
    """Return the twin's document with a sky, a chequered floor, a two-coloured ball, and plates and posts as a body."""
    root = ET.fromstring(twin_mjcf(robot, Scenario.nominal(robot)))
    visual, asset = add(root, "visual"), add(root, "asset")
    add(visual, "headlight", ambient="0.35 0.35 0.35", diffuse="0.45 0.45 0.45", specular="0 0 0")
    add(visual, "global", offwidth="640", offheight="640")
    sky = {"type": "skybox", "builtin": "gradient", "width": "256", "height": "256"}
    add(asset, "texture", name="sky", rgb1="0.93 0.95 0.97", rgb2="0.75 0.82 0.9", **sky)
    light, dark = _FLOOR
    chequers = {"builtin": "checker", "width": "256", "height": "256"}
    add(asset, "texture", name="floor", type="2d", rgb1=light, rgb2=dark, **chequers)
    add(asset, "texture", name="ball", type="cube", rgb1="0.93 0.93 0.93", rgb2="0.85 0.4 0.1", **chequers)
    repeated = (0.5 / _SQUARE, 0.5 / _SQUARE)
    add(asset, "material", name="floor", texture="floor", texuniform="true", texrepeat=repeated)
    add(asset, "material", name="ball", texture="ball")
    for name in ("floor", "ball"):
        geom = next(one for one in root.iter("geom") if one.get("name") == name)
        geom.set("material", name)
        geom.set("rgba", "1 1 1 1")
        geom.set("size", "0 0 1" if name == "floor" else geom.get("size", ""))  # the floor has no end
    body = next(one for one in root.iter("body") if one.get("name") == "body")
    body.remove(next(one for one in body.findall("geom") if one.get("name") == "body"))
    shape = body_shape(robot.body)
    radius, bottom, top = shape.radius, shape.bottom, shape.top
    plate = 0.02 * (top - bottom)
    for height in (bottom, 0.5 * (bottom + top), top):
        color = "0.12 0.37 0.62 1" if height == top else "0.6 0.62 0.66 1"
        add(body, "geom", type="cylinder", size=(radius, plate), pos=(0.0, 0.0, height), rgba=color)
    for wheel in wheel_shapes(robot):
        outward = wheel.contact * np.array([1.0, 1.0, 0.0])
        place = 0.8 * radius * outward / np.linalg.norm(outward)
        fromto = (*place[:2].tolist(), bottom, *place[:2].tolist(), top)
        add(body, "geom", type="capsule", size=(0.04 * radius,), fromto=fromto, rgba="0.35 0.38 0.42 1")
    return ET.tostring(root, encoding="unicode")

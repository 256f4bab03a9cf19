"""MuJoCo behind a typed interface: simulation, the content of a model, and the robot's ten states in its coordinates.

This is the only module that imports MuJoCo, whose bindings have no types.
"""

import math
import warnings

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Floats
from ballbot.errors import InputError, missing_package
from ballbot.mechanics.geometry import body_rates_matrix


class Engine:
    """A compiled MJCF document and its state, as arrays.

    The arrays are views into MuJoCo's memory: values written into them take effect, and `step` changes them.

    InputError if MuJoCo is not installed, or refuses the document.
    """

    def __init__(self, document: str) -> None:
        self._mujoco = mujoco = mujoco_module()
        try:
            self.model = mujoco.MjModel.from_xml_string(document)  # pyright: ignore[reportAttributeAccessIssue]
        except ValueError as error:
            reason = " ".join(str(error).split())
            raise InputError(f"MuJoCo cannot simulate this robot in this scenario: {reason}.") from None
        self.data = mujoco.MjData(self.model)  # pyright: ignore[reportAttributeAccessIssue]
        self._masses = self.model.body_mass.copy(), self.model.body_inertia.copy()
        self._step = mujoco.mj_step  # pyright: ignore[reportAttributeAccessIssue]
        self.timestep = float(self.model.opt.timestep)
        #: generalised positions and velocities, MuJoCo's order
        self.qpos: Floats = self.data.qpos
        self.qvel: Floats = self.data.qvel
        #: dry friction of each degree of freedom [N m]
        self.dry_friction: Floats = self.model.dof_frictionloss
        #: torques of the motors [N m]
        self.torques: Floats = self.data.ctrl

    def reset(self) -> None:
        """Set the state of the document, at rest, without the solver's last solution."""
        self._mujoco.mj_resetData(self.model, self.data)  # pyright: ignore[reportAttributeAccessIssue]

    def step(self) -> None:
        """Advance by one timestep."""
        self._step(self.model, self.data)

    def pressures(self, groups: NDArray[np.intp], count: int) -> Floats:
        """Return the sums (count,) of the last step's normal forces [N] over `count` groups of geoms.

        `groups` has the group of each geom, or -1; a contact belongs to the group of either of its geoms.
        """
        contact = self.data.contact
        address = contact.efc_address
        active = address >= 0
        group = groups[contact.geom].max(axis=1)[active]
        normal = self.data.efc_force[address[active]]
        sums = np.bincount(group[group >= 0], weights=normal[group >= 0], minlength=count)
        return sums.astype(np.float64)

    def geoms_below(self, prefix: str) -> list[int]:
        """Return the geoms whose names begin with a prefix."""
        names = (self.model.geom(i).name for i in range(self.model.ngeom))
        return [i for i, name in enumerate(names) if name.startswith(prefix)]

    def mobility(self, body: str) -> float:
        """Return MuJoCo's inverse weight [1/kg] of a body, by which it scales contact forces."""
        return float(self.model.body(body).invweight0[0])

    @property
    def floor_friction(self) -> Floats:
        """A view (5,) of the friction of the first contact pair, the ball on the floor."""
        return self.model.pair_friction[0]

    def set_mass(self, body: str, share: float) -> None:
        """Give a body that share of the document's mass and inertia.

        MuJoCo's inverse weights, by which it scales the softness of contacts, stay those of the document.
        """
        place, spec = self.model.body(body).id, self._masses
        self.model.body_mass[place], self.model.body_inertia[place] = (
            share * spec[0][place],
            share * spec[1][place],
        )

    def external_force(self, body: str) -> Floats:
        """Return a view (6,) of the force [N] at a body's centre of mass and the torque [N m], world frame."""
        return self.data.xfrc_applied[self.model.body(body).id]

    def center_of_mass(self, body: str) -> Floats:
        """Return a view (3,) of the position of a body's centre of mass at the last step's start [m]."""
        return self.data.xipos[self.model.body(body).id]

    def position(self, joint: str) -> Floats:
        """Return a view of a joint's coordinates in `qpos`; of a free joint (7,): place, then quaternion wxyz."""
        return self.data.joint(joint).qpos

    def velocity(self, joint: str) -> Floats:
        """Return a view of a joint's coordinates in `qvel`; of a free joint (6,): velocity, then angular velocity."""
        return self.data.joint(joint).qvel

    def positions(self, kind: str, count: int) -> slice:
        """Return the indices of the hinges "kind 1" to "kind count" in `qpos`, one for each wheel."""
        return _evenly_spaced([int(self.model.joint(f"{kind} {i}").qposadr[0]) for i in (1, 2)], count)

    def velocities(self, kind: str, count: int) -> slice:
        """Return the indices of the hinges "kind 1" to "kind count" in `qvel`, one for each wheel."""
        return _evenly_spaced([int(self.model.joint(f"{kind} {i}").dofadr[0]) for i in (1, 2)], count)


def mujoco_module():  # which has no types
    """Return MuJoCo; InputError if it is not installed."""
    try:
        import mujoco
    except ImportError:
        raise missing_package("The twin", "MuJoCo", extra="twin") from None
    return mujoco


def foreign_model(document: str, *, source: str):  # MjModel and MjData have no types
    """Return a document in MJCF or URDF compiled, and its data in the document's pose; a refusal names `source`.

    Meshes and what they need are left out, so that no file beside the document is needed. InputError if MuJoCo is not
    installed, or refuses the document, or a mass comes from a mesh.
    """
    mujoco = mujoco_module()
    heard: list[str] = []
    # else MuJoCo writes warnings into a file in the user's folder
    mujoco.set_mju_user_warning(heard.append)  # pyright: ignore[reportAttributeAccessIssue]
    try:
        with warnings.catch_warnings(action="error"):
            spec = mujoco.MjSpec.from_string(document)  # pyright: ignore[reportAttributeAccessIssue]
            _leave_out_files(spec)
            model = spec.compile()
        data = mujoco.MjData(model)  # pyright: ignore[reportAttributeAccessIssue]
        mujoco.mj_forward(model, data)  # pyright: ignore[reportAttributeAccessIssue]
        if heard:
            raise InputError(heard[0])
    except (ValueError, UserWarning) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{source} is not a model that MuJoCo reads: {reason}") from None
    finally:
        mujoco.set_mju_user_warning(None)  # pyright: ignore[reportAttributeAccessIssue]
    return model, data


def _leave_out_files(spec) -> None:  # MjSpec
    """Take meshes, height fields and textures, which are files of their own, out of a model."""
    for geom in list(spec.geoms):
        if geom.meshname or geom.hfieldname:
            if not geom.parent.explicitinertial and geom.mass != 0.0 and geom.density != 0.0:
                raise InputError(
                    f"The mass of the body {geom.parent.name[:80]!r} comes from a mesh, and meshes are not read; give "
                    "it an <inertial>, or the mesh mass 0."
                )
            spec.delete(geom)
        geom.material = ""
    for part in (*spec.meshes, *spec.hfields, *spec.skins, *spec.materials, *spec.textures):
        spec.delete(part)


def _evenly_spaced(indices: list[int], count: int) -> slice:
    # wheels are built alike, one after the other; a slice gives views where a list of indices would copy
    first, step = indices[0], indices[1] - indices[0]
    return slice(first, first + count * step, step)


def attitude_of(quaternion_wxyz: Floats, *, near_psi: float) -> Floats:
    """Return theta, phi, psi (3,) [rad] of R = Rx(theta) Ry(phi) Rz(psi), psi within half a turn of `near_psi`."""
    w, x, y, z = quaternion_wxyz.tolist()
    theta = math.atan2(2 * (w * x - y * z), 1 - 2 * (x * x + y * y))
    phi = math.asin(max(-1.0, min(1.0, 2 * (x * z + w * y))))
    psi = math.atan2(2 * (w * z - x * y), 1 - 2 * (y * y + z * z))
    return np.array([theta, phi, near_psi + math.remainder(psi - near_psi, 2 * math.pi)])


def body_rate(state: Floats) -> Floats:
    """Return w = B(Phi) Phi_dot (3,) [rad/s], body frame, of a state (10,)."""
    return body_rates_matrix(*state[2:5]) @ state[7:10]


def rotated(quaternion_wxyz: Floats, vector: Floats) -> Floats:
    """Return a vector (3,), given in a body's frame, in the frame that the body's unit quaternion refers to."""
    w, axis = float(quaternion_wxyz[0]), quaternion_wxyz[1:]
    twice = 2.0 * np.cross(axis, vector)
    return vector + w * twice + np.cross(axis, twice)

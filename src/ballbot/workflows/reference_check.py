"""Whether a robot can follow a reference: the torque, speed, power, lean and grip that it needs.

The closed loop with sensors shows falls and errors. How much of each limit is used follows, for the path followed
exactly, from the exact equations of motion backwards; if the path jumps, the closed loop's use counts.
Given x(t), y(t), psi(t), the five equations M q_ddot + bias = W^T u + rolling friction have two leans and n torques as
unknowns. Velocities Z (5, 2) that turn no wheel, W Z = 0 (the body turning with the ball), eliminate the torques:

    Z^T (M q_ddot + bias - rolling) = 0        about upright:  j theta_ddot - m_r g l theta = forcing

an unstable equation of which one solution stays small: the robot leans into a bend before the bend begins. It is
computed with the robot at rest before and after the path, by solving the linear equation for the residual of the exact
one until it vanishes. Then W^T u = M q_ddot + bias - rolling gives the torques, plus each wheel's dry friction.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_banded
from scipy.ndimage import gaussian_filter1d

from ballbot.arrays import Floats
from ballbot.control.controller import Controller
from ballbot.control.references import Reference
from ballbot.errors import InputError
from ballbot.mechanics.floor import rolling_friction
from ballbot.mechanics.friction import dry_friction_size
from ballbot.mechanics.model import Model
from ballbot.results import left_out, reported
from ballbot.robot import Robot
from ballbot.rounding import percent, unit_heading
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import FALLING_PART
from ballbot.simulation.model_plant import friction_needed_along, pack_contacts
from ballbot.simulation.run import initial_state_of, sample_count
from ballbot.twin.scenario import Scenario
from ballbot.workflows.limits import ControlledRobot, lost_lean
from ballbot.workflows.metrics import lean_angle

#: corners of a path are rounded by a Gaussian of this deviation [s]: a robot cannot change its speed at once
ROUNDING = 0.05
#: rest before and after the path [s], in which the robot leans into it and out of it
_REST = 2.0
_STEPS = 40  # of the correction at most
_ACCURATE = 1e-8  # change of the lean [rad] at which it has been found
_SLOW = 0.01  # [m/s, rad/s] below which friction's sign becomes a ramp


@dataclass(frozen=True, kw_only=True, eq=False)
class Demand:
    """The states and torques of the path, at each time."""

    t: Floats  #: (N,) [s]
    states: Floats  #: (N, 10)
    torques: Floats  #: (N, n) [N m]
    wheel_speeds: Floats  #: (N, n) [rad/s]


def path_demand(model: Model, poses: Floats, sample_time: float) -> Demand:
    """Return the torques for following poses x, y [m] and psi [rad], (N, 3), exactly; InputError if no lean can."""
    rest = int(np.ceil(_REST / sample_time))
    path = np.pad(poses, ((rest, rest), (0, 0)), mode="edge")
    path = gaussian_filter1d(path, ROUNDING / sample_time, axis=0, mode="nearest")
    q = np.zeros((len(path), 5))
    q[:, [0, 1, 4]] = path
    linear = _lean_equation(model, len(q), sample_time)
    for _ in range(_STEPS):
        _, forces = _rates_and_forces(model, q, sample_time)
        residual = np.einsum("kij,ki->kj", _without_turning(model.wheel_jacobian(q)), forces)
        residual[[0, -1]] = 0.0
        change = -solve_banded((1, 1), linear, residual)
        q[:, 2:4] += change
        if not np.abs(q[:, 2:4]).max() < 1.0:
            break
        if np.abs(change).max() < _ACCURATE:
            q_dot, forces = _rates_and_forces(model, q, sample_time)
            wrench_map = np.linalg.pinv(np.swapaxes(model.wheel_jacobian(q), 1, 2))
            torques = np.einsum("kij,kj->ki", wrench_map, forces)
            t = sample_time * np.arange(-rest, len(q) - rest, dtype=np.float64)
            speeds = model.wheel_speed(q, q_dot)
            dry = dry_friction_size(speeds, model.robot.friction, torque=torques)
            torques = torques + dry * np.clip(speeds / _SLOW, -1.0, 1.0)
            return Demand(t=t, states=np.hstack([q, q_dot]), torques=torques, wheel_speeds=speeds)
    raise InputError("No lean below 1 rad lets the robot follow this path; make it slower or rounder.")


def _rates_and_forces(model: Model, q: Floats, sample_time: float) -> tuple[Floats, Floats]:
    """Return q_dot (N, 5), and the generalised forces (N, 5) left for the wheels: M q_ddot + bias - rolling."""
    q_dot, q_ddot = np.zeros_like(q), np.zeros_like(q)  # zero at the ends, where all rests
    q_dot[1:-1] = (q[2:] - q[:-2]) / (2.0 * sample_time)
    q_ddot[1:-1] = (q[2:] - 2.0 * q[1:-1] + q[:-2]) / sample_time**2
    unforced = model.acceleration(q, q_dot, np.zeros((len(q), model.robot.wheel_count)))
    forces = np.einsum("kij,kj->ki", model.mass_matrix(q), q_ddot - unforced)
    forces[:, :2] -= rolling_friction(q_dot[:, :2], model.robot.rolling_force, slowest=_SLOW)
    return q_dot, forces


def _without_turning(W: Floats) -> Floats:
    """Return Z (N, 5, 2): W Z = 0, with unit rates of theta and phi."""
    others = np.linalg.pinv(W[:, :, [0, 1, 4]])
    solved = -others @ W[:, :, 2:4]
    Z = np.zeros((len(W), 5, 2))
    Z[:, [0, 1, 4]] = solved
    Z[:, 2, 0] = Z[:, 3, 1] = 1.0
    return Z


def _lean_equation(model: Model, rows: int, sample_time: float) -> Floats:
    """Return j lean_ddot - m_r g l lean as bands (3, rows), the mean of both leans; the lean is zero at both ends."""
    origin, body = np.zeros((1, 5)), model.robot.body
    Z = _without_turning(model.wheel_jacobian(origin))[0]
    inertia = Z.T @ model.mass_matrix(origin)[0]
    stiffness = 0.5 * float(inertia[0, 2] + inertia[1, 3]) / sample_time**2
    bands = np.empty((3, rows))
    bands[0] = bands[2] = stiffness
    bands[1] = -2.0 * stiffness - body.mass * model.robot.gravity * body.center_of_mass
    bands[1, [0, -1]], bands[0, 1], bands[2, -2] = 1.0, 0.0, 0.0
    return bands


#: change of a reference within a sample that is a jump [m, rad], as where runs are scored
JUMP = 0.02
_STEP = 1e-3  # inner step of the closed loop [s]
_RUNS = 5  # of the closed loop
_GRIP = 1.0  # friction coefficient of the wheels on the ball, as of the loop
_NO_LOAD = 100.0  # a wheel that needs a larger friction coefficient carries no load


@dataclass(frozen=True, kw_only=True)
class Use:
    """How much of a limit is used at most."""

    quantity: str  #: "torque", "wheel speed", "lean" or "grip"
    value: float
    limit: float
    unit: str
    t: float  #: when [s]
    wheel: int | None  #: which, from 1

    @reported
    def share(self) -> float:
        """Share of the limit; above 1 the limit is exceeded."""
        return self.value / self.limit

    @property
    def reason(self) -> str:
        """What exceeds the limit."""
        name, value, limit, unit = self._shown
        if value > _NO_LOAD:
            return f"a wheel lifts off the ball at t = {self.t:.2f} s"
        return f"{name} reaches {value:.3g} {unit} at t = {self.t:.2f} s, with a limit of {limit:.3g} {unit}"

    def row(self) -> list[str]:
        """Return its row of a table: see `MARGIN_HEADINGS`."""
        name, value, limit, unit = self._shown
        shown, share = ("lifted", "-") if value > _NO_LOAD else (f"{value:.3g}", percent(self.share))
        return [unit_heading(name, unit), shown, f"{limit:.3g}", share, f"{self.t:.2f}"]

    @property
    def _shown(self) -> tuple[str, float, float, str]:
        """Name, value, limit and unit, of an angle in degrees."""
        name = self.quantity if self.wheel is None else f"{self.quantity}, wheel {self.wheel}"
        if self.unit != "rad":
            return name, self.value, self.limit, self.unit
        return name, np.degrees(self.value), np.degrees(self.limit), "deg"


MARGIN_HEADINGS = ("quantity", "at most", "limit", "used", "when [s]")


@dataclass(frozen=True, kw_only=True)
class ReferenceMargins:
    """How much of the robot's limits a reference uses, and how it is followed in closed loop."""

    name: str  #: of the reference
    jumps: tuple[tuple[float, float], ...]  #: when [s] and by how much [m or rad]
    uses: tuple[Use, ...]  #: of the path followed exactly; of the closed loop if the path jumps
    peak_power: float  #: mechanical, of all motors, likewise [W]
    supply_voltage: float = field(metadata=left_out)  #: [V]
    ended: float  #: when the robot falls in closed loop [s]; infinity if it does not
    peak_error: float  #: largest distance from the reference in closed loop [m]
    share_at_torque_limit: float  #: share of the time with a wheel's torque at its limit

    @reported
    def can_be_followed(self) -> bool:
        """Whether no limit is exceeded and the robot does not fall."""
        return not self.reasons

    @reported
    def reasons(self) -> list[str]:
        """Why the robot cannot follow the reference; a robot that falls leans too far: that is no second reason."""
        fell = self.ended < np.inf
        reasons = [
            use.reason for use in self.uses if use.share > 1.0 and not (use.quantity == "lean" and fell)
        ]
        if fell:
            reasons.append(
                f"in closed loop it falls at t = {self.ended:.2f} s, after its torques were {self._limited}"
            )
        return reasons

    def verdict(self) -> list[str]:
        """Return whether the robot can follow the reference, and why not, in sentences."""
        lines = [f"The robot cannot follow {self.name}:", *(f"- {reason};" for reason in self.reasons)]
        lines[-1] = f"{lines[-1][:-1]}."
        if self.can_be_followed:
            tightest = max(self.uses, key=lambda use: use.share)
            used = f"{tightest.quantity}, {percent(tightest.share)} used"
            lines = [f"The robot can follow {self.name}; its tightest margin is {used}."]
        if self.ended == np.inf:
            lines.append(
                f"With this controller its largest distance from the reference is {self.peak_error:.3f} m, and its "
                f"torques are {self._limited}."
            )
        if self.jumps:
            t, size = self.jumps[0]
            more = f" and {len(self.jumps) - 1} more" if len(self.jumps) > 1 else ""
            lines.append(
                f"The reference jumps (by {size:.3g} at t = {t:g} s{more}). No robot follows a jump exactly, so only "
                "the closed loop is evaluated."
            )
        return [
            *lines,
            f"The motors deliver at most {self.peak_power:.3g} W, {self.peak_power / self.supply_voltage:.3g} A at "
            f"{self.supply_voltage:g} V, without the losses of the windings. Compare that with your supply: a robot "
            "file states no limit.",
        ]

    @property
    def _limited(self) -> str:
        share = self.share_at_torque_limit
        return f"at their limit {percent(share)} of the time" if share > 0.0 else "never at their limit"


def check_reference(
    robot: Robot,
    controller: Controller,
    reference: Reference,
    *,
    duration: float,
    name: str = "the reference",
) -> ReferenceMargins:
    """Return which share of a robot's limits a reference uses, and how the closed loop follows it in five runs."""
    sample_time = controller.sample_time
    loop = ControlledRobot(robot=robot, controller=controller, scenario=Scenario.nominal(robot), step=_STEP)
    wanted = np.array([reference(k * sample_time) for k in range(sample_count(duration, sample_time))])
    poses = wanted[:, [0, 1, 4]]
    changes = np.abs(np.diff(poses, axis=0)).max(axis=1, initial=0.0)
    jumps = np.flatnonzero(changes > JUMP)
    run = simulate_batch(
        loop.model,
        controller,
        reference,
        duration=duration,
        initial_states=np.array([initial_state_of(seed) for seed in range(_RUNS)]),
        imperfections=loop.plant.imperfections,
    )
    ends, states = run.t + sample_time, run.next_states
    going = ends <= run.ended[:, None] + 1e-9
    error = np.hypot(*(states[..., :2] - wanted[:, :2])[going].T)
    torques = run.torques[going]
    if len(jumps):
        t, x = np.broadcast_to(ends, going.shape)[going], states[going]
        speeds = loop.model.wheel_speed(x[:, :5], x[:, 5:])
        path = Demand(t=t, states=x, torques=torques, wheel_speeds=speeds)
    else:
        path = path_demand(Model(robot, step=_STEP), poses, sample_time)
    at_limit = np.abs(torques).max(axis=1) >= controller.torque_limit * (1.0 - 1e-9)
    return ReferenceMargins(
        name=name,
        jumps=tuple((float((k + 1) * sample_time), float(changes[k])) for k in jumps),
        uses=_uses(Model(robot), controller, path),
        peak_power=float((path.torques * path.wheel_speeds).sum(axis=1).max()),
        supply_voltage=robot.drive.supply_voltage,
        ended=float(run.ended.min()),
        peak_error=float(error.max()),
        share_at_torque_limit=float(np.mean(at_limit)),
    )


def _uses(model: Model, controller: Controller, path: Demand) -> tuple[Use, ...]:
    """Return the largest use of each limit along a path."""
    top = model.robot.drive.top_speed
    # the torque that is left in its direction: none at the motors' highest speed
    forward = path.wheel_speeds * np.sign(path.torques)
    left = controller.torque_limit * np.clip((top - forward) / (FALLING_PART * top), 1e-3, 1.0)
    needed = np.empty(len(path.t))
    states, torques = np.ascontiguousarray(path.states), np.ascontiguousarray(path.torques)
    friction_needed_along(model.selected, model.packed, pack_contacts(model.robot), states, torques, needed)
    uses = []
    for quantity, values, limit, unit in (
        ("torque", np.abs(path.torques), left, "N m"),
        ("wheel speed", np.abs(path.wheel_speeds), top, "rad/s"),
        ("lean", lean_angle(path.states[:, 2], path.states[:, 3]), lost_lean(model), "rad"),
        ("grip", needed, _GRIP, ""),
    ):
        limits = np.broadcast_to(limit, values.shape)
        worst = np.unravel_index(int((values / limits).argmax()), values.shape)
        uses.append(
            Use(
                quantity=quantity,
                value=float(values[worst]),
                limit=float(limits[worst]),
                unit=unit,
                t=float(path.t[worst[0]]),
                wheel=int(worst[1]) + 1 if values.ndim == 2 else None,
            )
        )
    return tuple(uses)

"""Whether a robot can follow a reference, before it is tried: the torque, speed, power, lean and grip it takes.

They are found twice: for the path followed exactly, by the equations run backwards (`path_demand`), and in closed
loop. A verdict with its reasons and a table are made from them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import real_array
from ballbot.control.controller import Controller
from ballbot.control.references import Reference
from ballbot.mechanics.model import Model
from ballbot.results import key, left_out, reported, to_results
from ballbot.robot import Robot
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.conditions import FALLING_PART, Conditions
from ballbot.simulation.model_plant import friction_needed_along, pack_contacts
from ballbot.simulation.run import sample_count
from ballbot.workflows.path_demand import lean_of, path_demand
from ballbot.workflows.recovery_region import lost_lean, top_speed

#: change of a reference within a sample that is a jump [m, rad], as where runs are scored
JUMP = 0.02
#: share of a limit from which a margin counts as thin
THIN = 0.8
_STEP = 1e-3  # inner step of the closed loop [s]


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


@dataclass(frozen=True, kw_only=True)
class Followed:
    """How the reference is followed in closed loop."""

    uses: tuple[Use, ...]
    share_at_torque_limit: float  #: share of the time in which a wheel's torque is at its limit
    ended: float  #: when the robot falls [s]; infinity if it does not
    peak_error: float  #: largest distance from the reference [m]
    peak_power: float  #: mechanical, of all motors [W]


@dataclass(frozen=True, kw_only=True)
class ReferenceMargins:
    """How much of the robot's limits a reference uses."""

    jumps: tuple[
        tuple[float, float], ...
    ]  #: when [s] and by how much [m or rad]; a path with jumps has no demand
    uses: tuple[Use, ...] = field(
        metadata=key("followed_exactly")
    )  #: of the path followed exactly; empty if it jumps
    peak_power: float | None  #: of the path followed exactly, mechanical [W]
    supply_voltage: float = field(metadata=left_out)  #: [V]
    closed: Followed = field(metadata=key("closed_loop"))

    @reported
    def can_be_followed(self) -> bool:
        """Whether no limit is exceeded and the robot does not fall."""
        return self.closed.ended == np.inf and all(
            use.share <= 1.0 for use in (*self.uses, *self.closed.uses)
        )


def check_reference(
    robot: Robot, controller: Controller, reference: Reference, *, duration: float, grip: float = 1.0
) -> ReferenceMargins:
    """Return what a reference takes of a robot on level ground, and what becomes of it with a controller.

    Parameters
    ----------
    robot : Robot
    controller : Controller
        Its torque limit counts.
    reference : callable
    duration : float
        [s]
    grip : float
        Friction coefficient of the wheels on the ball.

    Raises
    ------
    InputError
        Where the duration is none, the reference asks for a lean or a rate, or no lean can follow it.
    """
    model, sample_time = Model(robot, step=_STEP), controller.sample_time
    asked = np.array([reference(k * sample_time) for k in range(sample_count(duration, sample_time))])
    closed = _followed(model, controller, reference, asked, duration, grip)
    poses = asked[:, [0, 1, 4]]
    changes = np.abs(np.diff(poses, axis=0)).max(axis=1, initial=0.0)
    jumps = np.flatnonzero(changes > JUMP)
    if len(jumps):
        return ReferenceMargins(
            jumps=tuple((float((k + 1) * sample_time), float(changes[k])) for k in jumps),
            uses=(),
            peak_power=None,
            supply_voltage=robot.drive.supply_voltage,
            closed=closed,
        )
    demand = path_demand(model, poses, sample_time)
    return ReferenceMargins(
        jumps=(),
        uses=_uses(model, controller, demand.t, demand.states, demand.torques, grip),
        peak_power=float(demand.power.max()),
        supply_voltage=robot.drive.supply_voltage,
        closed=closed,
    )


def available_torque(
    robot: Robot, limit: float, torques: NDArray[np.float64], speeds: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the torque [N m] that motors have in the direction of `torques` at wheel speeds, of any shape."""
    top = top_speed(robot)
    forward = speeds * np.sign(torques)
    return limit * np.clip((top - forward) / (FALLING_PART * top), 0.0, 1.0)


def _followed(
    model: Model,
    controller: Controller,
    reference: Reference,
    asked: NDArray[np.float64],
    duration: float,
    grip: float,
) -> Followed:
    run = simulate_batch(
        model,
        controller,
        reference,
        duration=duration,
        conditions=[Conditions(top_speed=top_speed(model.robot))],
    )
    going = run.t <= run.ended[0] + 1e-9
    t, states, torques = run.t[going], run.states[0, going], run.torques[0, going]
    speeds = model.wheel_speed(states[:, :5], states[:, 5:])
    error = np.hypot(*(states[:, :2] - asked[going, :2]).T)
    return Followed(
        uses=_uses(model, controller, t, states, torques, grip),
        share_at_torque_limit=float(
            np.mean(np.abs(torques).max(axis=1) >= controller.torque_limit * (1.0 - 1e-9))
        ),
        ended=float(run.ended[0]),
        peak_error=float(error.max()),
        peak_power=float((torques * speeds).sum(axis=1).max()),
    )


def _uses(
    model: Model,
    controller: Controller,
    t: NDArray[np.float64],
    states: NDArray[np.float64],
    torques: NDArray[np.float64],
    grip: float,
) -> tuple[Use, ...]:
    """Return the largest use of each limit along states (N, 10) under torques (N, n)."""
    robot, limit = model.robot, controller.torque_limit
    speeds = model.wheel_speed(states[:, :5], states[:, 5:])
    left = available_torque(robot, limit, torques, speeds)
    short = np.abs(torques) / np.maximum(left, 1e-3 * limit)
    needed = np.empty(len(t))
    seen = real_array(states, (len(t), 10), "The array of states")
    given = real_array(torques, (len(t), robot.wheel_count), "The array of torques")
    friction_needed_along(model.selected, model.packed, pack_contacts(robot), seen, given, needed)
    k, wheel = np.unravel_index(short.argmax(), short.shape)
    f, fast = np.unravel_index(np.abs(speeds).argmax(), speeds.shape)
    g = int(needed.argmax())
    leans = lean_of(states)
    o = int(leans.argmax())
    return (
        Use(
            quantity="torque",
            value=float(abs(torques[k, wheel])),
            limit=float(max(left[k, wheel], 1e-3 * limit)),
            unit="N m",
            t=float(t[k]),
            wheel=int(wheel) + 1,
        ),
        Use(
            quantity="wheel speed",
            value=float(abs(speeds[f, fast])),
            limit=top_speed(robot),
            unit="rad/s",
            t=float(t[f]),
            wheel=int(fast) + 1,
        ),
        Use(
            quantity="lean",
            value=float(leans[o]),
            limit=lost_lean(model),
            unit="rad",
            t=float(t[o]),
            wheel=None,
        ),
        Use(quantity="grip", value=float(needed[g]), limit=grip, unit="", t=float(t[g]), wheel=None),
    )


MARGIN_HEADINGS = ("", "quantity", "at most", "limit", "used", "when (s)")


def reference_verdict(margins: ReferenceMargins, name: str) -> list[str]:
    """Return whether the robot can follow the reference of that name, and why not."""
    reasons = _reasons(margins)
    if reasons:
        said = [f"The robot cannot follow {name}:", *(f"- {reason};" for reason in reasons)]
        said[-1] = said[-1][:-1] + "."
    else:
        uses = (*margins.uses, *margins.closed.uses)
        tightest = max(uses, key=lambda use: use.share)
        margin = "a thin margin" if tightest.share > THIN else "its tightest margin"
        said = [f"The robot can follow {name}; {margin} is {tightest.quantity}, {tightest.share:.0%} used."]
    closed = margins.closed
    if closed.ended == np.inf:
        said.append(
            f"With this controller its largest distance from the reference is {closed.peak_error:.3f} m, and "
            f"its torques are at their limit {closed.share_at_torque_limit:.1%} of the time."
        )
    if margins.jumps:
        t, size = margins.jumps[0]
        more = f" and {len(margins.jumps) - 1} more" if len(margins.jumps) > 1 else ""
        said.append(
            f"The reference jumps (by {size:.3g} at t = {t:g} s{more}). No robot follows a jump exactly, so "
            "only the closed loop is judged."
        )
    power = closed.peak_power if margins.peak_power is None else max(margins.peak_power, closed.peak_power)
    said.append(
        f"The motors deliver at most {power:.3g} W, {power / margins.supply_voltage:.3g} A at "
        f"{margins.supply_voltage:g} V, without the losses of the windings. A robot file has no limit of "
        "power."
    )
    return said


def margin_rows(margins: ReferenceMargins) -> list[list[str]]:
    """Return the table's rows: of the path followed exactly, and in closed loop."""
    parts = (("followed exactly", margins.uses), ("closed loop", margins.closed.uses))
    return [[which, *_row(use)] for which, uses in parts for use in uses]


def margin_results(margins: ReferenceMargins) -> dict[str, object]:
    """Return what results.json holds."""
    return {"reasons": _reasons(margins), **to_results(margins)}


def _reasons(margins: ReferenceMargins) -> list[str]:
    reasons = [_reason(use) for use in margins.uses if use.share > 1.0]
    closed = margins.closed
    uses = [
        use
        for use in closed.uses
        if use.share > 1.0 and not (use.quantity == "lean" and closed.ended < np.inf)
    ]
    reasons += [f"in closed loop {_reason(use)}" for use in uses]
    if closed.ended < np.inf:
        reasons.append(
            f"in closed loop it falls at t = {closed.ended:.2f} s, after its torques were at their limit "
            f"{closed.share_at_torque_limit:.0%} of the time"
        )
    return reasons


def _reason(use: Use) -> str:
    match use.quantity:
        case "torque":
            return (
                f"wheel {use.wheel} needs {use.value:.3g} N m at t = {use.t:.2f} s, and its motor gives "
                f"{use.limit:.3g} N m"
            )
        case "wheel speed":
            return (
                f"wheel {use.wheel} has to turn at {use.value:.3g} rad/s at t = {use.t:.2f} s, and the supply "
                f"allows {use.limit:.3g} rad/s"
            )
        case "lean":
            return (
                f"the robot has to lean by {np.degrees(use.value):.3g} degrees at t = {use.t:.2f} s, and beyond "
                f"{np.degrees(use.limit):.3g} degrees full torque does not bring it back"
            )
        case _:
            if use.value > _NOTHING_HELPS:
                return f"a wheel lifts off the ball at t = {use.t:.2f} s"
            return (
                f"a wheel needs a friction coefficient of {use.value:.3g} on the ball at t = {use.t:.2f} s, and "
                f"has {use.limit:.3g}"
            )


#: friction coefficients above this are those of a wheel on which nothing presses
_NOTHING_HELPS = 100.0


def _row(use: Use) -> list[str]:
    value, limit, unit = use.value, use.limit, use.unit
    if unit == "rad":
        value, limit, unit = np.degrees(value), np.degrees(limit), "degrees"
    name = use.quantity if use.wheel is None else f"{use.quantity}, wheel {use.wheel}"
    name += f" ({unit})" if unit else ""
    shown = ["lifted", f"{limit:.3g}", "-"] if value > _NOTHING_HELPS else []
    return [name, *(shown or [f"{value:.3g}", f"{limit:.3g}", f"{use.share:.0%}"]), f"{use.t:.2f}"]

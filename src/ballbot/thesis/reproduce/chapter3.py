"""Chapters 2, the basic model, and 3, friction: Figures 2.1, 3.1, 3.2, 3.4 and 3.5."""

from __future__ import annotations

import numpy as np

from ballbot.identification.driveline import Sweep
from ballbot.thesis.reproduce.bench import BASIC, FIRST_LEAN, Bench
from ballbot.thesis.reproduce.item import RUNS, Check, Item, over_runs
from ballbot.workflows.metrics import position_error


def figure_2_1(bench: Bench) -> Item:
    """The robot's frame and its generalised coordinates, a drawing."""
    return Item(
        name="Figure 2.1",
        title="The robot and its generalised coordinates",
        thesis="The thesis draws the robot with x and y of the ball on the floor and theta, phi and psi of "
        "the body.",
        ours=f"Ours is drawn to scale from the parameters of Appendix III ({bench.robot.name}), from its "
        "right and from above, with the same coordinates: x forward, y left, z up, and R = Rx(theta) "
        "Ry(phi) Rz(psi).",
    )


#: the supply's speed limit that the thesis reads from its sweep [rad/s]
THESIS_LIMIT = 27.7
#: speed at which the wheels are held beside each other [rad/s], and how wide a sample of rows is taken there
_SPEED, _NEAR = 10.0, 0.5
#: part of the largest of three values by which they may differ and be "roughly the same"
_ROUGHLY = 0.2


def figure_3_1(bench: Bench) -> Item:
    """Torque and speed of the free wheels under a slow sine of torque."""
    fastest = max(float(np.abs(sweep.speed).max()) for sweep in bench.sweeps)
    torques = [_torque_at(sweep, _SPEED) for sweep in bench.sweeps]
    spread = (max(torques) - min(torques)) / max(torques)
    return Item(
        name="Figure 3.1",
        title="Torque and speed of the wheels, without the ball, under 1 N m at a period of 62.83 s",
        thesis="All three wheels have roughly the same characteristic, with a speed limit at 27.7 rad/s.",
        ours=f"The twin's wheels reach {fastest:.2f} rad/s; at {_SPEED:g} rad/s they take "
        f"{', '.join(f'{torque:.3f}' for torque in torques)} N m.",
        checks=(
            Check(
                claim="the speed limit is at 27.7 rad/s",
                quantity="greatest speed of a wheel",
                value=fastest,
                unit="rad/s",
                lowest=0.99 * THESIS_LIMIT,
                highest=1.01 * THESIS_LIMIT,
            ),
            Check(
                claim="all wheels are roughly the same",
                quantity=f"spread of their torques at {_SPEED:g} rad/s, of the largest",
                value=spread,
                highest=_ROUGHLY,
            ),
        ),
    )


def figure_3_2(bench: Bench) -> Item:
    """One wheel's sweep beside the models with and without friction."""
    fit, sweep = bench.driveline_fit, bench.sweeps[0]
    b, c = fit.values[:2]
    speed = np.abs(sweep.speed[sweep.speed != 0.0])
    share = float(np.sum(b * speed + c) / np.sum(fit.law.steady_friction(speed)))
    return Item(
        name="Figure 3.2",
        title="One wheel's sweep: measured, with and without friction in the model",
        thesis="The model with friction is nearer to the measurement than the one without; most of the "
        "friction is viscous and Coulomb.",
        ours=f"Over the sweep the speed errs by {fit.rmse:.2f} rad/s with the friction found (where the "
        f"supply does not limit it) and by {fit.rmse_without:.2f} rad/s without, whose clamp (3.2) winds up "
        "and holds the wheel at the limit while the torque brakes (mistake 9); viscous and Coulomb friction "
        f"are {100.0 * share:.0f} % of it, summed over the sweep.",
        checks=(
            Check(
                claim="the model with friction is nearer",
                quantity="RMS error without friction over that with",
                value=fit.rmse_without / fit.rmse,
                lowest=1.0,
            ),
            Check(
                claim="most of the friction is viscous and Coulomb",
                quantity="their share",
                value=share,
                lowest=0.5,
            ),
        ),
    )


def figure_3_4(bench: Bench) -> Item:
    """The ball on the clamped wheels under its own LQR."""
    movement, friction = bench.ball_movement, bench.contact.friction
    asked = movement.reference[-1]
    missed = {
        name: float(np.abs(run.rotations[-1] - asked).max() / asked.max())
        for name, run in (("with", movement.with_friction), ("without", movement.without_friction))
    }
    free = np.where(movement.reference == 0.0, movement.without_friction.rotations, 0.0)
    ratio = movement.off_axis_with_friction / max(float(np.abs(free).max()), 1e-9)
    coulomb = ", ".join(f"{c:.3f}" for c in friction.coulomb)
    balancing = ", ".join(f"{c:.3f}" for c in bench.identified.friction.coulomb)
    return Item(
        name="Figure 3.4",
        title="The ball on the clamped wheels, one axis asked to turn at a time",
        thesis="Without friction the ball follows without a steady error; with friction it does not, and it "
        "moves about several axes where one is asked for.",
        ours="The friction is that of drivelines and contacts, identified with the robot upside down as section 3.2 "
        f"has it (c = {coulomb} N m), not the one of balancing (c = {balancing} N m), which is another and holds "
        "under the robot's weight. At the end the ball misses less than 0.001 % of the angle asked for without "
        f"friction and {100.0 * missed['with']:.3g} % with; about an axis not asked for it turns by up to "
        f"{1e3 * movement.off_axis_with_friction:.0f} mrad with friction.",
        checks=(
            Check(
                claim="without friction there is no steady error",
                quantity="share of the angle missed at the end",
                value=missed["without"],
                highest=1e-5,
            ),
            Check(
                claim="with friction there is one",
                quantity="share of the angle missed at the end",
                value=missed["with"],
                lowest=0.05,
            ),
            Check(
                claim="friction moves the ball about axes that were not asked for",
                quantity="largest turn about one with friction",
                value=1e3 * movement.off_axis_with_friction,
                unit="mrad",
                lowest=5.0,
            ),
            Check(
                claim="and does so more than the controller alone",
                quantity="the same over that without friction, 1e-9 rad at least",
                value=min(ratio, 1e3),
                lowest=10.0,
            ),
        ),
    )


def figure_3_5(bench: Bench) -> Item:
    """The models about the origin under the same LQR, from a small lean."""
    late = {
        name: [1e3 * float(position_error(log)[log.t >= 0.5 * log.t[-1]].max()) for log in logs]
        for name, logs in bench.standing.items()
    }
    return Item(
        name="Figure 3.5",
        title="The models with and without friction, holding the origin from a small lean",
        thesis="The basic model goes to the origin at once and stays, so that its path is not seen; the one "
        "with friction moves around the origin.",
        ours=f"In the second half of a minute, from leans of {1e3 * FIRST_LEAN:g} mrad to {RUNS} sides, the basic "
        "model is within a micrometre of the origin, by the exact equations and by the thesis's own; the one with "
        f"friction is up to {over_runs(late['friction'])} mm from it.",
        checks=(
            *(
                Check.over(
                    late[name],
                    claim=f"the basic model stands still at the origin ({BASIC[name]})",
                    quantity="its largest distance in the last half minute",
                    unit="mm",
                    highest=1e-3,
                )
                for name in BASIC
            ),
            Check.over(
                late["friction"],
                claim="the model with friction moves around it",
                quantity="its largest distance in the last half minute",
                unit="mm",
                lowest=20.0,
            ),
        ),
    )


def _torque_at(sweep: Sweep, speed: float) -> float:
    """Return the mean size of the torque at which a wheel turns about that fast, either way [N m]."""
    near = np.abs(np.abs(sweep.speed) - speed) < _NEAR
    return float(np.abs(sweep.torque[near]).mean())

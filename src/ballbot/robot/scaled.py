"""A robot that is not quite the one described: its body and its friction by shares of what they were."""

from __future__ import annotations

from dataclasses import replace

from ballbot.robot.robot import Body, Friction


def scaled_body(body: Body, *, mass: float, height: float) -> Body:
    """Return a body of another mass whose centre lies at another height, each by its factor.

    The inertia about the centre of mass grows with the mass; what the height does to it about the ball's centre
    follows.
    """
    central = mass * body.inertia_about_center_of_mass()
    return replace(
        body,
        mass=mass * body.mass,
        center_of_mass=height * body.center_of_mass,
        inertia=tuple(float(central[i]) for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))),
        inertia_about="center_of_mass",
    )


def scaled_friction(friction: Friction, factor: float) -> Friction:
    """Return friction whose torques and whose rolling resistance are that many times as large; speeds stay."""
    return replace(
        friction,
        viscous=tuple(factor * one for one in friction.viscous),
        coulomb=tuple(factor * one for one in friction.coulomb),
        stribeck=tuple(factor * one for one in friction.stribeck),
        rolling=factor * friction.rolling,
    )

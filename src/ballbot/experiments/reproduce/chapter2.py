"""Chapter 2, the basic model: Figure 2.1."""

from __future__ import annotations

from ballbot.experiments.reproduce.bench import Bench
from ballbot.experiments.reproduce.item import Item


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

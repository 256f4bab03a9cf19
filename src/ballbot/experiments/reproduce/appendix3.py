"""Appendix III, parameters: Figure III.1 in numbers."""

from __future__ import annotations

import math

from ballbot.experiments.reproduce.bench import Bench
from ballbot.experiments.reproduce.item import Check, Item
from ballbot.identification.swing import Pivot, inertia_of_swing

#: what the swing gave, by Appendix III [kg m^2]
THESIS_INERTIA = 4.37


def figure_iii_1(bench: Bench) -> Item:
    """The body hung up at the ball's centre and let swing."""
    fit = bench.swing
    found = inertia_of_swing(fit, bench.robot, Pivot.of(bench.robot))
    pivot, own = found.about_pivot, found.about_center_of_mass
    return Item(
        name="Figure III.1",
        title="The body's inertia from a swing",
        thesis="The thesis shows a frame of the film of the hanging body, and gives 4.37 kg m^2 by I = m g "
        "r / omega_n^2; neither the frequency nor an uncertainty is printed.",
        ours=f"A body of that inertia swings at {fit.frequency:.4f} rad/s, with a period of "
        f"{2.0 * math.pi / fit.frequency:.4f} s. From {fit.swing.swings:.0f} swings filmed at 30 frames a "
        f"second and followed to 3 mrad, `ballbot check --swing` finds {pivot.value:.4f} ± "
        f"{pivot.half_width:.4f} kg m^2 about the pivot, and {own.value:.3f} about the centre of mass.",
        checks=(
            Check(
                claim="the inertia about the ball's centre is 4.37 kg m^2",
                quantity="found from the swing, less that, over the half width of 95 %",
                value=abs(pivot.value - THESIS_INERTIA) / pivot.half_width,
                highest=1.0,
            ),
        ),
    )

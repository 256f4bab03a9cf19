"""The thesis's misprints and mistakes, each with the number that shows it, computed.

equations.py    printed equations that are wrong or incomplete: 1 to 3, 10, 16 to 18
mechanics.py    physics of the model: 4 to 8
numbers.py      limits, parameters and error measures: 9, 11, 12, 15
conclusions.py  what is read from residuals, the gain away from psi = 0, and A r = 0: 13, 14, 19
"""

from __future__ import annotations

from collections.abc import Callable

from ballbot.thesis.reproduce.bench import Bench
from ballbot.thesis.reproduce.item import Mistake
from ballbot.thesis.reproduce.mistakes import conclusions, equations, mechanics, numbers

#: in the order of the list
MISTAKES: tuple[Callable[[Bench], Mistake], ...] = (
    equations.rotation_about_y,
    equations.velocity_over_ground,
    equations.derivative_of_angles,
    mechanics.rates_of_angles,
    mechanics.inertia_counted_twice,
    mechanics.no_counter_torque,
    mechanics.rotors_left_out,
    mechanics.friction_on_absolute_spin,
    numbers.speed_clamp_printed,
    equations.seam_curve,
    numbers.ball_inertia,
    numbers.rounded_constants,
    conclusions.residual_pairs,
    conclusions.gain_at_other_headings,
    numbers.error_over_count,
    equations.nonholonomic_rates,
    equations.locked_wheels_twice,
    equations.undefined_inverses,
    conclusions.reference_and_stability,
)

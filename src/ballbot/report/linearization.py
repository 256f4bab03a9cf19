"""A and B of x_dot = A x + B u about upright: for results.json in full precision, and as text.

The exact model's are the ones to design with. The thesis's formulation stands beside them only where it is marked as
what it is.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ballbot.log.columns import STATE_NAMES, torque_names, unit_of

if TYPE_CHECKING:  # the compiled model is slow to import
    from ballbot.mechanics.linear import LinearModel
    from ballbot.mechanics.model import Model

#: what is wrong with each matrix that the thesis's mistakes are in; the numbers are those of docs/reproduce.md
MISTAKEN_MATRICES = {
    "T_trw": "the thesis's mistake 6: without the motors' counter-torque; the exact model does not use it",
    "T_owr": "the thesis's mistake 8: absolute spin, where motor, friction and encoder have the speed against the "
    "body; the exact model does not use it",
}
MISTAKEN_LINEARIZATION = (
    "the thesis's mistakes 5, 6, 7 and 17 (docs/reproduce.md): to compare with, not to design with"
)


def linearization_results(model: Model) -> dict[str, object]:
    """Return what results.json holds of a model's linearization, the thesis's formulation marked beside it.

    Parameters
    ----------
    model : Model
        In the exact formulation, with the friction whose viscous part is to be in A.
    """
    names = [*STATE_NAMES]
    return {
        "about": "upright, at rest, psi = 0; viscous friction only",
        "state": names,
        "state_units": [unit_of(name) for name in names],
        "input": [*torque_names(model.robot.wheel_count)],
        "input_unit": "N m",
        "exact": _matrices(model.linearize()),
        "thesis": {"mistake": MISTAKEN_LINEARIZATION}
        | _matrices(replace(model, formulation="thesis").linearize()),
    }


def state_order(wheel_count: int) -> str:
    """Return what the rows and columns of A and B are, as a line of text."""
    states = ", ".join(f"{name} [{unit_of(name)}]" for name in STATE_NAMES)
    return f"x = {states}\nu = {', '.join(torque_names(wheel_count))} [N m]"


def _matrices(linear: LinearModel) -> dict[str, object]:
    return {"A": linear.A.tolist(), "B": linear.B.tolist()}

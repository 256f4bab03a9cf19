"""Where the exact equations depart from the thesis's Appendix II, each beside the equation it mends."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot.errors import InputError
from ballbot.mechanics.parameters import Formulation


@dataclass(frozen=True, kw_only=True)
class Corrections:
    """What of Appendix II's physics is corrected; its misprints (II.6), (II.15), (II.30) always are.

    Any mixture can be derived, so that the share of each approximation in a pole or a gain can be told.
    """

    body_rates: bool
    """(II.24) takes the Euler angles' rates Phi_dot for the body's angular velocity: in the body's frame for
    (II.25), in the world's for (II.16) and (II.33). Corrected: B(Phi) Phi_dot, in the frame that each of them
    wants."""

    inertia_about_center_of_mass: bool
    """(II.22) puts the inertia that the pendulum measured about the ball's centre beside v_body of (II.23),
    which already moves the mass: m_r l^2 counts twice. Corrected: the inertia about the centre of mass."""

    locked_wheels_once: bool
    """(II.27) adds the wheels' whole spin energy, though the body's inertia holds the locked wheels already.
    Corrected: the share of the spin that the locked wheels have, a_i . w, is taken off."""

    reflected_rotors: bool
    """(II.28) leaves out rotor and gear. Corrected: n^2 (j_m + j_g) on the wheel's speed relative to the
    body; the rotor's cross term with the body's rate, n j_m, is neglected (0.03 to 0.12 % of the BBR's
    accelerations)."""

    counter_torque: bool
    """(II.32) has the force at the wheels' hubs act on the body and not the motors' counter-torque: (r_b +
    r_w)/r_b times too much, and torque times (II.16) is not the motors' power. Corrected: the counter-torque
    u_i a_i is added, and the wheel speed that friction and an encoder see is the one relative to the body."""

    nonholonomic_wheels: bool
    """(II.34) is Lagrange's equation for energies in which the wheels' speeds (II.16) are already put in. These
    are no derivatives of functions of q, for which that would be allowed. Corrected: the difference, which does
    no work (Chaplygin's or Voronets's terms), is taken off."""


_NONE = Corrections(
    body_rates=False,
    inertia_about_center_of_mass=False,
    locked_wheels_once=False,
    reflected_rotors=False,
    counter_torque=False,
    nonholonomic_wheels=False,
)
_ALL = Corrections(
    body_rates=True,
    inertia_about_center_of_mass=True,
    locked_wheels_once=True,
    reflected_rotors=True,
    counter_torque=True,
    nonholonomic_wheels=True,
)


def corrections_of(formulation: Formulation) -> Corrections:
    """Return what the named formulation corrects: everything ("exact") or nothing ("thesis").

    Raises
    ------
    InputError
        Where the name is neither.
    """
    named: dict[str, Corrections] = {"exact": _ALL, "thesis": _NONE}
    if formulation not in named:
        raise InputError(
            f"There is no formulation {formulation!r}; the formulations are 'exact' and 'thesis'"
        )
    return named[formulation]

"""Where a robot's long-worded values become the paper's symbols.

The compiled equations read one row of numbers for each robot (`pack`), so that every robot in a batch
can have values of its own. `Parameters` gives these numbers their names back inside compiled code.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.mechanics.compiled import inlined
from ballbot.mechanics.formulation import Formulation
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.vector import loaded
from ballbot.robot import Robot
from ballbot.robot.derived import reflected_rotor_inertia

#: robots that one vectorised loop steps side by side; a constant, so that strides are known when compiling
LANES = 32

RIGID_SIZE = 26  # numbers before the wheels' own
WHEEL_SIZE = 6  # axle (3), b, c, s

# Places in a row of packed numbers that identification changes
PLACE_SPEED_SCALE = 8  # 1/v_s
PLACE_EXPONENT = 9  # delta
PLACE_ROLLING = 10  # N C_rr
PLACE_PIVOTING = 13  # limit of the pivoting friction

_SIX = (0, 0, 0, 0, 0, 0)


class Exact(NamedTuple):
    """Selects the exact equations of design section 5; `wheels` carries the number of wheels in its length."""

    wheels: tuple[int, ...]


class Thesis(NamedTuple):
    """Selects the equations of the thesis's Appendix II as printed; `wheels` as in `Exact`."""

    wheels: tuple[int, ...]


class Pivoting(NamedTuple):
    """Selects the exact equations with a sixth velocity, the ball's spin about the vertical; `wheels` as in `Exact`."""

    wheels: tuple[int, ...]


class Wheel(NamedTuple):
    """One wheel's numbers, in compiled code."""

    axle: tuple[float, float, float]  #: its row of A
    b: float
    c: float
    s: float
    inv_vs: float  #: 1/v_s [s/rad]
    delta: float


class Parameters(NamedTuple):
    """One robot's numbers, in compiled code."""

    inv_rb: float  #: 1/r_b [1/m]
    k: float  #: 1 + r_w/r_b
    m_t: float  #: m_b + j_b/r_b^2 + m_r [kg]
    ml: float  #: m_r l [kg m]
    g: float  #: [m/s^2]
    d1: float  #: D1 = d1 D, likewise d2 and d3 (design section 5) [kg m^2]
    d2: float
    d3: float
    rolling: float  #: N C_rr [N]
    ml2: float  #: m_r l^2 [kg m^2], in the thesis's equations
    j_b: float  #: [kg m^2], where the ball pivots
    pivoting: float  #: largest pivoting friction [N m], where the ball pivots
    J: tuple[float, float, float, float, float, float]  #: body inertia: J_0, or the printed j_r
    D: tuple[float, float, float, float, float, float]  #: A^T A
    wheels: tuple[Wheel, ...]


def selector(
    formulation: Formulation, wheel_count: int, *, pivoting: bool = False
) -> Exact | Thesis | Pivoting:
    """Return the value that selects the compiled equations.

    Raises
    ------
    InputError
        Where the thesis's equations are asked for with a pivoting ball, which they do not have.
    """
    wheels = tuple(range(wheel_count))
    if pivoting and formulation == "thesis":
        raise InputError("The thesis's equations have no pivoting ball; take the formulation 'exact' for it.")
    if pivoting:
        return Pivoting(wheels)
    return Exact(wheels) if formulation == "exact" else Thesis(wheels)


def pack(robot: Robot, formulation: Formulation, *, pivoting: float = 0.0) -> NDArray[np.float64]:
    """Return one robot's numbers as the row that compiled code reads.

    Parameters
    ----------
    robot : Robot
    formulation : {"exact", "thesis"}
        "thesis" takes the body's inertia as printed, whatever point it is about, and leaves the rotors out.
    pivoting : float
        Largest pivoting friction [N m]; read where the ball pivots.

    Returns
    -------
    ndarray (26 + 6 n,)
        In the order of `Parameters`; wheels last, one after another.
    """
    ball, body, wheels = robot.ball, robot.body, robot.wheels
    A = transforms(robot).T_owb
    D = A.T @ A
    k = 1.0 + wheels.radius / ball.radius
    exact = formulation == "exact"
    drive = robot.drive
    rotor = reflected_rotor_inertia(
        gear_ratio=drive.gear_ratio, motor_inertia=drive.motor_inertia, gear_inertia=drive.gear_inertia
    )
    j_w, j_r = wheels.inertia, rotor if exact else 0.0
    J = body.inertia_about_ball_center() if exact else body.inertia_matrix()
    friction = robot.friction
    rigid = [
        1.0 / ball.radius,
        k,
        ball.mass + ball.inertia / ball.radius**2 + body.mass,
        body.mass * body.center_of_mass,
        robot.gravity,
        j_w + j_r,
        j_w * k + j_r,
        j_w * (2.0 * k - 1.0) + j_r,
        1.0 / friction.stribeck_speed,
        friction.stribeck_exponent,
        (ball.mass + body.mass) * robot.gravity * friction.rolling,
        body.mass * body.center_of_mass**2,
        ball.inertia,
        pivoting,
        *_symmetric(J),
        *_symmetric(D),
    ]
    own = np.column_stack([A, friction.viscous, friction.coulomb, friction.stribeck])
    return np.concatenate([rigid, own.ravel()])


def friction_places(wheel_count: int) -> NDArray[np.int64]:
    """Return where b, c, s of each wheel, 1/v_s, delta and N C_rr stand in a packed row: (3 n + 3,)."""
    first = RIGID_SIZE + WHEEL_SIZE * np.arange(wheel_count)
    return np.concatenate(
        [first + 3, first + 4, first + 5, [PLACE_SPEED_SCALE, PLACE_EXPONENT, PLACE_ROLLING]]
    )


def _symmetric(S: NDArray[np.float64]) -> list[float]:
    return [S[0, 0], S[1, 1], S[2, 2], S[0, 1], S[0, 2], S[1, 2]]


# --- compiled: one robot's numbers out of a flat array whose row i begins at i * LANES ---


@inlined
def entry(work, row, lane):
    """Return the number of that row and lane."""
    return work[
        np.uint64(row * LANES + lane)
    ]  # unsigned: no test for an index from the end, which keeps a loop scalar


@inlined
def entry_after(work, row, i, lane):
    """Return the number i rows after `row`."""
    return entry(work, row + i, lane)


@inlined
def _load_wheel(work, row, wheel, lane):
    first = row + WHEEL_SIZE * wheel
    return Wheel(
        (entry(work, first, lane), entry(work, first + 1, lane), entry(work, first + 2, lane)),
        entry(work, first + 3, lane),
        entry(work, first + 4, lane),
        entry(work, first + 5, lane),
        entry(work, PLACE_SPEED_SCALE, lane),
        entry(work, PLACE_EXPONENT, lane),
    )


@inlined
def load(selected, work, lane):
    """Return the `Parameters` of one lane."""
    return Parameters(
        entry(work, 0, lane),
        entry(work, 1, lane),
        entry(work, 2, lane),
        entry(work, 3, lane),
        entry(work, 4, lane),
        entry(work, 5, lane),
        entry(work, 6, lane),
        entry(work, 7, lane),
        entry(work, PLACE_ROLLING, lane),
        entry(work, 11, lane),
        entry(work, 12, lane),
        entry(work, PLACE_PIVOTING, lane),
        loaded(entry_after, _SIX, work, 14, lane),
        loaded(entry_after, _SIX, work, 20, lane),
        loaded(_load_wheel, selected.wheels, work, RIGID_SIZE, lane),
    )

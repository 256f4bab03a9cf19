"""The two formulations, and one robot's numbers as compiled code reads them: its values become the paper's symbols.

The compiled equations read one row of numbers for each robot (`pack`), so that every robot in a batch can have values
of its own. `Parameters` gives these numbers their names back inside compiled code.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import by_types_of, inlined
from ballbot.mechanics.engine.lanes import TORQUE, entry, restored
from ballbot.mechanics.engine.vector import each, each_with, second, written
from ballbot.mechanics.friction import (
    NO_TERMS,
    DirectedLaw,
    PlainLaw,
    WheelLaw,
    WheelTerms,
    friction_terms,
    loaded_coulomb,
    wheel_law,
)
from ballbot.mechanics.geometry import transforms
from ballbot.robot import Robot
from ballbot.robot.derived import reflected_rotor_inertia

#: "exact": the corrected rigid-body model; "thesis": Appendix II as printed, only its misprints mended
Formulation = Literal["exact", "thesis"]


RIGID_SIZE = 26  # numbers before the wheels' own
WHEEL_SIZE = 6  # axle (3), b, c, s
TERMS_SIZE = len(WheelTerms._fields)  # after all wheels, for each of a `DirectedLaw`

# Places in a row of packed numbers that identification changes
PLACE_SPEED_SCALE = 8  # 1/v_s
PLACE_EXPONENT = 9  # delta
PLACE_ROLLING = 10  # N C_rr
PLACE_PIVOTING = 13  # limit of the pivoting friction

_PLAIN = PlainLaw()

# How compiled code takes a row apart
_SIX = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_COMMON = (0.0, 0.0)  # 1/v_s and delta
_RIGID = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, _COMMON, 0.0, 0.0, 0.0, 0.0, _SIX, _SIX)
_WHEEL = ((0.0, 0.0, 0.0), 0.0, 0.0, 0.0)


class Exact(NamedTuple):
    """Selects the exact equations; `wheels` carries their number in its length, `law` their friction's terms."""

    wheels: tuple[int, ...]
    law: WheelLaw


class Thesis(NamedTuple):
    """Selects the equations of the thesis's Appendix II as printed; its members as in `Exact`."""

    wheels: tuple[int, ...]
    law: WheelLaw


class Pivoting(NamedTuple):
    """Selects the exact equations with a sixth velocity, the ball's spin about the vertical; members as in `Exact`."""

    wheels: tuple[int, ...]
    law: WheelLaw


class Wheel(NamedTuple):
    """One wheel's numbers, in compiled code."""

    axle: tuple[float, float, float]  #: its row of A
    b: float
    c: float
    s: float
    inv_vs: float  #: 1/v_s [s/rad]
    delta: float


class DirectedWheel(NamedTuple):
    """One wheel's numbers, in compiled code, with every term of the friction."""

    axle: tuple[float, float, float]  #: its row of A
    b: float
    c: float  #: the motor's load included
    s: float
    inv_vs: float  #: 1/v_s [s/rad]
    delta: float
    terms: WheelTerms


class Parameters(NamedTuple):
    """One robot's numbers, in compiled code."""

    inv_rb: float  #: 1/r_b [1/m]
    k: float  #: 1 + r_w/r_b
    m_t: float  #: m_b + j_b/r_b^2 + m_r [kg]
    ml: float  #: m_r l [kg m]
    g: float  #: [m/s^2]
    d1: float  #: D1 = d1 D, likewise d2 and d3 (docs/mechanics.md) [kg m^2]
    d2: float
    d3: float
    rolling: float  #: N C_rr [N]
    ml2: float  #: m_r l^2 [kg m^2], in the thesis's equations
    j_b: float  #: [kg m^2], where the ball pivots
    pivoting: float  #: largest pivoting friction [N m], where the ball pivots
    J: tuple[float, float, float, float, float, float]  #: body inertia: J_0, or the printed j_r
    D: tuple[float, float, float, float, float, float]  #: A^T A
    wheels: tuple[Wheel | DirectedWheel, ...]


def selector(
    formulation: Formulation, wheel_count: int, *, pivoting: bool = False, law: WheelLaw = _PLAIN
) -> Exact | Thesis | Pivoting:
    """Return the value that selects the compiled equations and, by `law`, the terms of the wheels' friction.

    Raises
    ------
    InputError
        If the thesis's equations are asked for with a pivoting ball, which they do not have.
    """
    wheels = tuple(range(wheel_count))
    if pivoting and formulation == "thesis":
        raise InputError("The thesis's equations have no pivoting ball; use the formulation 'exact'.")
    if pivoting:
        return Pivoting(wheels, law)
    return Exact(wheels, law) if formulation == "exact" else Thesis(wheels, law)


def row_size(selected: Exact | Thesis | Pivoting) -> int:
    """Return how many numbers a packed robot has."""
    own = WHEEL_SIZE + (TERMS_SIZE if isinstance(selected.law, DirectedLaw) else 0)
    return RIGID_SIZE + own * len(selected.wheels)


def pack(
    robot: Robot, formulation: Formulation, *, pivoting: float = 0.0, law: WheelLaw | None = None
) -> NDArray[np.float64]:
    """Return one robot's numbers as the row that compiled code reads.

    Parameters
    ----------
    robot : Robot
    formulation : {"exact", "thesis"}
        "thesis" takes the body's inertia as printed, whatever point it is about, and leaves the rotors out.
    pivoting : float
        Largest pivoting friction [N m]; read where the ball pivots.
    law : PlainLaw or DirectedLaw, optional
        That of the selector: the leanest for the robot by default. `PlainLaw` leaves out what else the robot has.

    Returns
    -------
    ndarray (26 + 6 n,), or (26 + 9 n,) for a `DirectedLaw`
        In the order of `Parameters`; wheels one after another, then their further terms.
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
    if isinstance(law or wheel_law(friction), PlainLaw):
        return np.concatenate([rigid, own.ravel()])
    return np.concatenate([rigid, own.ravel(), friction_terms(friction).columns().ravel()])


def row_count(selected) -> int:  # pragma: no cover (compiled form below)
    """Return `row_size` in compiled code."""
    raise NotImplementedError("compiled code only")


@by_types_of(row_count)
def _row_count(selected):
    size = np.int64(RIGID_SIZE + len(selected.types[0]) * (WHEEL_SIZE + TERMS_SIZE * _is_directed(selected)))
    return lambda selected: size


def friction_places(wheel_count: int) -> NDArray[np.int64]:
    """Return where b, c, s of each wheel, 1/v_s, delta and N C_rr stand in a packed row: (3 n + 3,)."""
    first = RIGID_SIZE + WHEEL_SIZE * np.arange(wheel_count)
    return np.concatenate(
        [first + 3, first + 4, first + 5, [PLACE_SPEED_SCALE, PLACE_EXPONENT, PLACE_ROLLING]]
    )


def term_places(wheel_count: int) -> NDArray[np.int64]:
    """Return where d, e and mu of each wheel stand in the packed row of a `DirectedLaw`: (3, n)."""
    first = RIGID_SIZE + WHEEL_SIZE * wheel_count
    return first + TERMS_SIZE * np.arange(wheel_count) + np.arange(TERMS_SIZE)[:, None]


def _symmetric(S: NDArray[np.float64]) -> list[float]:
    return [S[0, 0], S[1, 1], S[2, 2], S[0, 1], S[0, 2], S[1, 2]]


# --- compiled: one robot's numbers out of a block's work array (`ballbot.mechanics.engine.lanes`) ---


@inlined
def _wheel_of(own, common):
    return Wheel(own[0], own[1], own[2], own[3], common[0], common[1])


@inlined
def _directed_wheel_of(wheel, terms):
    return DirectedWheel(wheel.axle, wheel.b, wheel.c, wheel.s, wheel.inv_vs, wheel.delta, terms)


@inlined
def _loaded_wheel(wheel, torque):
    c = loaded_coulomb(wheel.c, wheel.terms, torque)
    return DirectedWheel(wheel.axle, wheel.b, c, wheel.s, wheel.inv_vs, wheel.delta, wheel.terms)


@inlined
def _load_plain_wheel(work, wheel, lane):
    own = restored(_WHEEL, work, RIGID_SIZE + WHEEL_SIZE * wheel, lane)
    return _wheel_of(own, restored(_COMMON, work, PLACE_SPEED_SCALE, lane))


def load_wheel(selected, work, wheel, lane) -> Wheel:  # pragma: no cover (compiled form below)
    """Return the `Wheel` or `DirectedWheel` of that number of one lane, under the torque in the lane."""
    raise NotImplementedError("compiled code only")


@by_types_of(load_wheel)
def _load_wheel(selected, work, wheel, lane):
    if not _is_directed(selected):
        return lambda selected, work, wheel, lane: _load_plain_wheel(work, wheel, lane)

    def directed(selected, work, wheel, lane):
        first = RIGID_SIZE + WHEEL_SIZE * len(selected.wheels)
        terms = restored(NO_TERMS, work, first + TERMS_SIZE * wheel, lane)
        return _loaded_wheel(
            _directed_wheel_of(_load_plain_wheel(work, wheel, lane), terms),
            entry(work, TORQUE + wheel, lane),
        )

    return directed


def _is_directed(selected) -> bool:
    """Return whether the type of a selector selects a `DirectedLaw`."""
    return selected.types[1].instance_class is DirectedLaw


def load_parameters(selected, work, lane) -> Parameters:  # pragma: no cover (compiled form below)
    """Return the `Parameters` of one lane without a motor's load."""
    raise NotImplementedError("compiled code only")


@by_types_of(load_parameters)
def _load_parameters(selected, work, lane):
    if not _is_directed(selected):
        return lambda selected, work, lane: _load_plain(selected, work, lane)

    def directed(selected, work, lane):
        first = RIGID_SIZE + WHEEL_SIZE * len(selected.wheels)
        terms = restored(each_with(second, selected.wheels, NO_TERMS), work, first, lane)
        P = _load_plain(selected, work, lane)
        return _with_wheels(P, each(_directed_wheel_of, P.wheels, terms))

    return directed


def under_torque(selected, P, u) -> Parameters:  # pragma: no cover (compiled form below)
    """Return the `Parameters` with the friction that the motors' torques u load the drives with."""
    raise NotImplementedError("compiled code only")


@by_types_of(under_torque)
def _under_torque(selected, P, u):
    if not _is_directed(selected):
        return lambda selected, P, u: P
    return lambda selected, P, u: _with_wheels(P, each(_loaded_wheel, P.wheels, u))


def load(selected, work, lane) -> Parameters:  # pragma: no cover (compiled form below)
    """Return the `Parameters` of one lane of a whole block's work array, under the torques in the lane."""
    raise NotImplementedError("compiled code only")


@by_types_of(load)
def _load(selected, work, lane):
    if not _is_directed(selected):
        return lambda selected, work, lane: _load_plain(selected, work, lane)
    return lambda selected, work, lane: under_torque(
        selected,
        load_parameters(selected, work, lane),
        restored(selected.wheels, work, TORQUE, lane),
    )


@inlined
def _with_wheels(P, wheels):
    return Parameters(
        P.inv_rb,
        P.k,
        P.m_t,
        P.ml,
        P.g,
        P.d1,
        P.d2,
        P.d3,
        P.rolling,
        P.ml2,
        P.j_b,
        P.pivoting,
        P.J,
        P.D,
        wheels,
    )


@inlined
def _load_plain(selected, work, lane):
    rigid = restored(_RIGID, work, 0, lane)
    inv_rb, k, m_t, ml, g, d1, d2, d3, common, rolling, ml2, j_b, pivoting, J, D = rigid
    own = restored(each_with(second, selected.wheels, _WHEEL), work, RIGID_SIZE, lane)
    wheels = each_with(_wheel_of, own, common)
    return Parameters(inv_rb, k, m_t, ml, g, d1, d2, d3, rolling, ml2, j_b, pivoting, J, D, wheels)


def state_like(selected) -> tuple:  # pragma: no cover (compiled form below)
    """Return zeros, as many as a state has numbers: ten, and the spin where the ball pivots."""
    raise NotImplementedError("compiled code only")


@by_types_of(state_like)
def _state_like(selected):
    size = 11 if selected.instance_class is Pivoting else 10
    return written("selected", "(" + "0.0, " * size + ")")

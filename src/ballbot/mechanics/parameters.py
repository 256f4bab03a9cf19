"""The two formulations, and one robot's numbers as compiled code reads them: its values become the paper's symbols.

The compiled equations read one row of numbers for each robot (`pack`), so that every robot in a batch can have values
of its own. `RobotNumbers` is the list of these numbers: sizes, places and what reads a row (`engine/lanes.py`) follow
from its fields. A number is added by a field and its value in `pack`.
"""

import sys
from collections.abc import Sequence
from functools import cache
from hashlib import sha256
from itertools import accumulate
from typing import Literal, NamedTuple, get_args, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.errors import InputError
from ballbot.mechanics.engine.tracing import instructions_of, traced
from ballbot.mechanics.friction import NO_TERMS, OwnWheel, Wheel, WheelTerms, friction_terms
from ballbot.mechanics.geometry import transforms
from ballbot.robot import Friction, Robot
from ballbot.robot.friction_law import MOST_PARAMETERS, FrictionLaw

#: "exact": the corrected rigid-body model; "thesis": Appendix II as printed, only its misprints mended
Formulation = Literal["exact", "thesis"]


class Exact(NamedTuple):
    """Selects the exact equations; `wheels` carries their number in its length.

    The classes that select equations have subclasses for registered friction laws, with the law's `OwnWheel`.
    """

    wheels: tuple[int, ...]

    own_wheel = None


class Thesis(NamedTuple):
    """Selects the equations of the thesis's Appendix II as printed."""

    wheels: tuple[int, ...]

    own_wheel = None


class Pivoting(NamedTuple):
    """Selects the exact equations with a sixth velocity, the ball's spin about the vertical."""

    wheels: tuple[int, ...]

    own_wheel = None


class RobotNumbers(NamedTuple):
    """One robot's numbers, in compiled code: a packed row has them in this order, `wheels` last."""

    inv_rb: float  #: 1/r_b [1/m]
    k: float  #: 1 + r_w/r_b
    m_t: float  #: m_b + j_b/r_b^2 + m_r [kg]
    ml: float  #: m_r l [kg m]
    #: g along the floor's x and y and its normal, upward; (0, 0, g) on a level one [m/s^2]
    gravity: tuple[float, float, float]
    weighed: float  #: m_b + m_r [kg]
    weight: tuple[float, float, float]  #: of these masses, in the axes of `gravity` [N]
    d1: float  #: D1 = d1 D, likewise d2 and d3 (docs/mechanics.md) [kg m^2]
    d2: float
    d3: float
    decay: tuple[float, float]  #: 1/v_s [s/rad] and delta, as every `Wheel` has them
    rolling_force: float  #: N C_rr [N]
    ml2: float  #: m_r l^2 [kg m^2], in the thesis's equations
    j_b: float  #: [kg m^2], where the ball pivots
    pivoting: float  #: largest pivoting friction [N m], where the ball pivots
    J: tuple[float, float, float, float, float, float]  #: body inertia: J_0, or the printed j_r
    D: tuple[float, float, float, float, float, float]  #: A^T A
    wheels: tuple[Wheel, ...]


def _zeros(shape: object) -> float | tuple:
    """Return zeros of the shape of a field's type: a number, or a tuple of them."""
    if shape is WheelTerms:
        return NO_TERMS
    return 0.0 if shape is float else tuple(_zeros(inner) for inner in get_args(shape))


def _count(shape: float | tuple) -> int:
    """Return how many numbers are in a tuple of tuples."""
    return sum(_count(inner) for inner in shape) if isinstance(shape, tuple) else 1


def _fields(kind: type, *, without: tuple[str, ...]) -> dict[str, float | tuple]:
    """Return zeros of the shape of each field of a named tuple."""
    return {name: _zeros(hint) for name, hint in get_type_hints(kind).items() if name not in without}


def _columns(shapes: dict[str, float | tuple]) -> dict[str, int]:
    """Return where each field begins."""
    sizes = [_count(shape) for shape in shapes.values()]
    return dict(zip(shapes, accumulate(sizes, initial=0), strict=False))


_RIGID = _fields(RobotNumbers, without=("wheels",))
_WHEEL = _fields(Wheel, without=("inv_vs", "delta"))
#: zeros of the shape in which a row has the numbers before the wheels' own, and a wheel's
RIGID_SHAPE, WHEEL_SHAPE = tuple(_RIGID.values()), tuple(_WHEEL.values())
RIGID_SIZE, WHEEL_SIZE = _count(RIGID_SHAPE), _count(WHEEL_SHAPE)
#: wheels of the largest robot, and the size of its row
MAX_WHEELS = 4
LARGEST_ROW = RIGID_SIZE + (WHEEL_SIZE + MOST_PARAMETERS) * MAX_WHEELS

#: where each of `RobotNumbers` begins in a packed row, and each number of a wheel among its own
COLUMNS, WHEEL_COLUMNS = _columns(_RIGID), _columns(_WHEEL)
COLUMN_SPEED_SCALE = COLUMNS["decay"]  # 1/v_s
COLUMN_EXPONENT = COLUMN_SPEED_SCALE + 1  # delta


_LAW_MARK = "_by_"


def __getattr__(name: str) -> type:
    """Return the class of a registered law's equations or wheel; code kept on disk names laws of other processes."""
    kinds = {base.__name__: base for base in (Exact, Thesis, Pivoting, OwnWheel)}
    kind = kinds.get(name.partition(_LAW_MARK)[0])
    if kind is None or _LAW_MARK not in name:
        raise AttributeError(name)
    globals()[name] = made = type(name, (kind,), {"__module__": __name__, "__slots__": ()})
    return made


@cache
def _by_law(kind: type, law: FrictionLaw) -> type:
    """Return the class of a registered law's equations or wheel; its name tells what the law computes."""
    try:
        written = instructions_of(law.size, 2 + len(law.takes))
    except Exception as error:
        raise InputError(
            f"The friction law {law.name} cannot be compiled: {error} It may use arithmetic, np.exp, np.log, np.sqrt, "
            "np.tanh, np.abs, np.minimum, np.maximum and np.where, and no `if` on a number."
        ) from error
    token = sha256(f"{law.name} {law.takes} {written}".encode()).hexdigest()[:16]
    made = getattr(sys.modules[__name__], f"{kind.__name__}{_LAW_MARK}{law.name}_{token}")
    if kind is OwnWheel:
        made.size = staticmethod(law.size)
    else:
        made.own_wheel, made.parameter_count = _by_law(OwnWheel, law), len(law.takes)
    return made


def selector(
    formulation: Formulation, wheel_count: int, *, pivoting: bool = False, law: FrictionLaw | None = None
) -> Exact | Thesis | Pivoting:
    """Return the value that selects the compiled equations; a registered law takes the place of the classical one.

    InputError if the thesis's equations are asked for with a pivoting ball, which they do not have.
    """
    wheels = tuple(range(wheel_count))
    if pivoting and formulation == "thesis":
        raise InputError("The thesis's equations have no pivoting ball; use the formulation 'exact'.")
    kind = Pivoting if pivoting else Exact if formulation == "exact" else Thesis
    return (_by_law(kind, law) if law else kind)(wheels)


@traced
def row_size(selected: Exact | Thesis | Pivoting) -> int:
    """Return how many numbers a packed robot has."""
    return RIGID_SIZE + (WHEEL_SIZE + parameter_count(selected)) * len(selected.wheels)


def parameter_count(selected: Exact | Thesis | Pivoting) -> int:
    """Return how many parameters a registered friction law has; 0 of the classical one, whose are among a wheel's."""
    return selected.parameter_count if selected.own_wheel else 0  # pyright: ignore[reportAttributeAccessIssue]


_STRAIGHT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def pack(
    robot: Robot,
    formulation: Formulation,
    *,
    pivoting: float = 0.0,
    upward: Sequence[float] = (0.0, 0.0, 1.0),
    seat: ArrayLike = _STRAIGHT,
) -> NDArray[np.float64]:
    """Return one robot's numbers as the row (row_size,) that compiled code reads, in the order of `RobotNumbers`.

    Wheels come one after another, and then the parameters of a registered friction law, those of one wheel after those
    of another. The formulation "thesis" takes the body's inertia as printed, whatever point it is about, and leaves the
    rotors out. `pivoting` is the largest pivoting friction [N m], read where the ball pivots; `upward` (3,) the
    vertical in the frame of the floor, a unit vector, read by the exact equations; `seat` (3, 3) the rotation from the
    frame whose z axis goes through the body's centre of mass to the wheels' own.
    """
    ball, body, wheels = robot.ball, robot.body, robot.wheels
    A = transforms(robot).T_owb @ np.asarray(seat)
    D = A.T @ A
    k = 1.0 + wheels.radius / ball.radius
    exact = formulation == "exact"
    j_w, j_r = wheels.inertia, robot.drive.reflected_inertia if exact else 0.0
    J = body.inertia_about_ball_center() if exact else body.inertia_matrix()
    friction = robot.friction
    rigid = RobotNumbers(
        inv_rb=1.0 / ball.radius,
        k=k,
        m_t=ball.mass + ball.inertia / ball.radius**2 + body.mass,
        ml=body.mass * body.center_of_mass,
        gravity=(robot.gravity * upward[0], robot.gravity * upward[1], robot.gravity * upward[2]),
        weighed=ball.mass + body.mass,
        weight=(robot.weight * upward[0], robot.weight * upward[1], robot.weight * upward[2]),
        d1=j_w + j_r,
        d2=j_w * k + j_r,
        d3=j_w * (2.0 * k - 1.0) + j_r,
        decay=(1.0 / friction.stribeck_speed, friction.stribeck_exponent),
        rolling_force=robot.rolling_force,
        ml2=body.mass * body.center_of_mass**2,
        j_b=ball.inertia,
        pivoting=pivoting,
        J=_symmetric(J),
        D=_symmetric(D),
        wheels=(),
    )
    numbers = np.concatenate([np.ravel(value) for value in rigid])
    terms = friction_terms(friction)
    law = friction.own_law
    if law:
        terms[:, 2] = 1.0  # see `OwnWheel.factor`
    of_wheels = np.column_stack([A, friction.viscous, friction.coulomb, friction.stribeck, terms])
    return np.concatenate([numbers, of_wheels.ravel(), _law_values(friction, law).ravel() if law else []])


def wheels_of(
    friction: Friction, axles: ArrayLike = ((0.0, 0.0, 0.0),)
) -> tuple[Wheel, ...] | tuple[OwnWheel, ...]:
    """Return the numbers of wheels with these rows of A (n, 3), or of a free one, without a motor's load."""
    law, rows, terms = (
        friction.own_law,
        np.asarray(axles, dtype=float).tolist(),
        friction_terms(friction).tolist(),
    )
    if law:
        own = zip(rows, friction.viscous, terms, _law_values(friction, law).tolist(), strict=True)
        kind = _by_law(OwnWheel, law)
        return tuple(kind(tuple(row), b, d, 1.0, tuple(values), 0.0) for row, b, (d, _, _), values in own)
    wheels = zip(rows, friction.viscous, friction.coulomb, friction.stribeck, terms, strict=True)
    shape = 1.0 / friction.stribeck_speed, friction.stribeck_exponent
    return tuple(Wheel(tuple(row), b, c, s, WheelTerms(*of), *shape) for row, b, c, s, of in wheels)


def _law_values(friction: Friction, law: FrictionLaw) -> NDArray[np.float64]:
    """Return the parameters (n, k) of a registered law, in its order."""
    own, count = dict(friction.own), len(friction.viscous)
    values = [own[name] if name in own else getattr(friction, name) for name in law.takes]
    return np.array([np.broadcast_to(value, (count,)) for value in values], dtype=float).reshape(-1, count).T


def law_columns(wheel_count: int, index: int, law: FrictionLaw) -> NDArray[np.int64]:
    """Return the indices (n,) in a packed row of one parameter of a registered law."""
    return RIGID_SIZE + WHEEL_SIZE * wheel_count + len(law.takes) * np.arange(wheel_count) + index


def friction_columns(wheel_count: int) -> NDArray[np.int64]:
    """Return where b, c, s of each wheel, 1/v_s, delta and N C_rr stand in a packed row: (3 n + 3,)."""
    first = RIGID_SIZE + WHEEL_SIZE * np.arange(wheel_count)
    of_wheels = [first + WHEEL_COLUMNS[name] for name in ("b", "c", "s")]
    return np.concatenate([*of_wheels, [COLUMN_SPEED_SCALE, COLUMN_EXPONENT, COLUMNS["rolling_force"]]])


def term_columns(wheel_count: int) -> NDArray[np.int64]:
    """Return where d, e and mu of each wheel stand in a packed row: (3, n)."""
    first = RIGID_SIZE + WHEEL_SIZE * np.arange(wheel_count) + WHEEL_COLUMNS["terms"]
    return first + np.arange(len(WheelTerms._fields))[:, None]


def _symmetric(S: NDArray[np.float64]) -> tuple[float, float, float, float, float, float]:
    return S[0, 0], S[1, 1], S[2, 2], S[0, 1], S[0, 2], S[1, 2]

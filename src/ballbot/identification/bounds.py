"""Within which values each quantity is sought; a user may set them, in Python or in a TOML file.

    viscous = [0.0, 0.1]             # b [N m s/rad], every wheel's
    coulomb = [0.0, 0.5]             # c [N m]
    stribeck = [0.0, 0.5]            # s [N m]
    stribeck_speed = [0.1, 3.0]      # v_s [rad/s]
    stribeck_exponent = [0.3, 10.0]  # delta
    rolling = [0.0, 0.05]            # C_rr
    delay = [0.012, 0.012]           # held at that value [s]

Keys left out keep the defaults of `ballbot.identification.quantities`, which are wide for a robot of 5 to 50 kg with
motors of some N m. Bounds hold for every number of a quantity, in its unit. Equal bounds hold it at that
value, so that a value known from elsewhere, as a delay, takes part. A v_s far below the speeds of the log with a large
s is friction that hardly ever acts, and traps a search: hence the bound at 0.1 rad/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from difflib import get_close_matches
from pathlib import Path

from ballbot.errors import InputError
from ballbot.identification.quantities import BY_NAME, Interval
from ballbot.inputs import read_toml


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """The least and the greatest value of quantities; None keeps the default.

    Raises
    ------
    InputError
        Where a pair is not two finite numbers in rising order, or reaches below what is physical.
    """

    viscous: Interval | None = None  #: b [N m s/rad], every wheel's
    coulomb: Interval | None = None  #: c [N m], every wheel's
    stribeck: Interval | None = None  #: s [N m], every wheel's
    stribeck_speed: Interval | None = None  #: v_s [rad/s]
    stribeck_exponent: Interval | None = None  #: delta [-]
    rolling: Interval | None = None  #: C_rr [-]
    load: Interval | None = None  #: mu [-], every wheel's
    pivoting: Interval | None = None  #: T_p [N m]
    center_of_mass: Interval | None = None  #: l [m]
    second_moment: Interval | None = None  #: S_x, S_y and S_z [kg m^2]
    ball_inertia: Interval | None = None  #: j_b [kg m^2]
    wheel_inertia: Interval | None = None  #: j_w [kg m^2]
    rotor_inertia: Interval | None = None  #: j_r [kg m^2], at the wheel
    torque_gain: Interval | None = None  #: [-], every motor's
    torque_offset: Interval | None = None  #: [N m], every motor's
    delay: Interval | None = None  #: [s]
    imu_delay: Interval | None = None  #: [s]
    velocity_delay: Interval | None = None  #: [s]
    lean_bias: Interval | None = None  #: [rad], about x and about y
    gyro_bias: Interval | None = None  #: [rad/s], about x, y and z

    def __post_init__(self) -> None:
        for name in self.given:
            lower, upper = self.interval(name) or (math.nan, math.nan)
            if not (math.isfinite(lower) and math.isfinite(upper) and lower <= upper):
                raise InputError(
                    f"The bounds of {name} are [{lower}, {upper}]; the lower one must come first."
                )
            scale = BY_NAME[name].scale
            if (lower < 0.0 and scale != "signed") or (lower <= 0.0 and scale == "ratio"):
                least = "above zero" if scale == "ratio" else "zero or more"
                raise InputError(f"The lower bound of {name} is {lower:g}; it must be {least}.")
        if self.delay is not None and self.delay[0] < 0.0:
            raise InputError(
                f"The lower bound of delay is {self.delay[0]:g}; it must be "
                "zero or more, because an effect cannot precede its cause."
            )

    @property
    def given(self) -> tuple[str, ...]:
        """The names of the quantities that are given bounds."""
        return tuple(field.name for field in fields(self) if self.interval(field.name) is not None)

    def interval(self, name: str) -> Interval | None:
        """Return the bounds of the quantity of that name, None where the defaults hold."""
        return getattr(self, name)


def read_bounds(path: str | Path) -> Bounds:
    """Read bounds from a TOML file; the module's text shows one.

    Raises
    ------
    InputError
        Where the file cannot be read, is no TOML, or has a key or a value that makes no bounds.
    """
    entries = read_toml(path)
    names = [field.name for field in fields(Bounds)]
    unknown = [key for key in entries if key not in names]
    if unknown:
        near = get_close_matches(unknown[0], names, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"the keys are {', '.join(names)}."
        raise InputError(f"{path}: {unknown[0]!r} is not a quantity that can be identified; {hint}")
    try:
        return Bounds(**{key: _interval(key, value) for key, value in entries.items()})
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _interval(key: str, value: object) -> Interval:
    match value:
        case [int() | float() as lower, int() | float() as upper]:
            return float(lower), float(upper)
    raise InputError(f"{key} is {value!r}; write two numbers, as in {key} = [0.1, 0.5].")

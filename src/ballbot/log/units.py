"""Units that foreign logs use, and what turns them into Ballbot's."""

import math

from ballbot.errors import InputError

#: by Ballbot's unit, the factors that turn others of the same kind into it
FACTORS = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "m/s^2": {"m/s^2": 1.0, "g": 9.80665},
    "rad": {"rad": 1.0, "deg": math.pi / 180.0, "turn": 2.0 * math.pi},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": 2.0 * math.pi / 60.0},
    "N m": {"N m": 1.0, "mN m": 1e-3, "N cm": 1e-2},
}


def factor_to(unit: str, given: str, *, counts_per_turn: float | None = None) -> float:
    """Return the factor that turns a value in `given` into one in `unit`.

    Parameters
    ----------
    unit : str
        Ballbot's unit, a key of `FACTORS`.
    given : str
        The file's unit; for angles and rates also "counts" and "counts/s" of an encoder.
    counts_per_turn : float, optional
        Encoder counts in one turn of what the column describes (of the wheel, gear included).

    Raises
    ------
    InputError
        Where the unit is not one of that kind, or counts come without `counts_per_turn`.
    """
    units = FACTORS[unit]
    if given in units:
        return units[given]
    counted = {"rad": "counts", "rad/s": "counts/s"}.get(unit)
    if given != counted:
        choices = [*units, *([counted] if counted else [])]
        raise InputError(
            f"the unit {given!r} cannot be converted to {unit}; the units that can are {', '.join(choices)}"
        )
    if not counts_per_turn:
        raise InputError(f"the unit {given!r} needs counts_per_turn, the encoder counts in one turn")
    return 2.0 * math.pi / counts_per_turn

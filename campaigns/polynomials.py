"""The polynomials of `ballbot.mechanics.engine.elementary` and of the firmware: Chebyshev fits in forty digits.

.venv/bin/python -m campaigns.polynomials          prints coefficients and their largest errors
"""

from collections.abc import Callable

import numpy as np
from mpmath import atan, atanh, chebyfit, cos, exp, log, mp, mpf, nstr, pi, sin, sqrt, tan, tanh

_TINY = mpf("1e-12")  # below it a quotient's limit is taken


def fits() -> dict[str, tuple[list[float], str]]:
    """Return name -> (coefficients, lowest power first; largest error) as `elementary` names them."""
    with mp.workdps(40):
        return _fits()


def _fits() -> dict[str, tuple[list[float], str]]:
    # a little beyond pi/4: where an angle lies between two quadrants is itself rounded
    quarter, lean = (pi / 4 * mpf("1.001")) ** 2, mpf("1.3") ** 2
    largest_f = (sqrt(mpf(2)) - 1) / (sqrt(mpf(2)) + 1)
    half = mpf(1) / 2
    return {
        "_SINE": _fit(_sine, mpf(0), quarter, 6),
        "_COSINE": _fit(_cosine, mpf(0), quarter, 6),
        "_SINE_OF_LEAN": _fit(_sine, mpf(0), lean, 7),
        "_COSINE_OF_LEAN": _fit(_cosine, mpf(0), lean, 7),
        "_POWER": _fit(lambda x: (mpf(2) ** x - 1) / x if abs(x) > _TINY else log(2), -half, half, 10),
        "_LOGARITHM": _fit(_logarithm, mpf(0), largest_f**2, 7),
    }


def single_fits() -> dict[str, tuple[list[np.float32], str]]:
    """Return name -> (coefficients, lowest power first; largest error) as the firmware's `ballbot_math.c` names them.

    Terms that are written out there are not among the coefficients: -r^2/2 of the cosine and 2/ln 2 of the logarithm.
    """
    with mp.workdps(40):
        fits = _single_fits()
    return {
        name: ([np.float32(c) for c in coefficients], error) for name, (coefficients, error) in fits.items()
    }


def _single_fits() -> dict[str, tuple[list[float], str]]:
    quarter = (pi / 4 * mpf("1.001")) ** 2
    largest_f = (sqrt(mpf(2)) - 1) / (sqrt(mpf(2)) + 1)
    half, eighth_turn = log(2) / 2 * mpf("1.01"), tan(pi / 8) * mpf("1.001")
    return {
        "SINE": _fit(_sine, mpf(0), quarter, 3),
        "COSINE": _fit(_cosine_beyond_square, mpf(0), quarter, 3),
        "EXPONENTIAL": _fit(_exponential, -half, half, 5),
        "LOGARITHM": _fit(_logarithm_beyond_line, mpf(0), largest_f**2 * mpf("1.01"), 3),
        "TANGENT": _fit(_hyperbolic_tangent, mpf(0), (mpf("0.55") * mpf("1.001")) ** 2, 5),
        "ARCTANGENT": _fit(_arctangent, mpf(0), eighth_turn**2, 5),
    }


def _fit(function: Callable[[mpf], mpf], low: mpf, high: mpf, terms: int) -> tuple[list[float], str]:
    coefficients, error = chebyfit(function, [low, high], terms, error=True)
    return [float(c) for c in reversed(coefficients)], nstr(error, 2)


def _sine(square: mpf) -> mpf:
    x = sqrt(abs(square))
    return (sin(x) / x - 1) / square if square > _TINY else -mpf(1) / 6 + square / 120


def _cosine(square: mpf) -> mpf:
    return (cos(sqrt(abs(square))) - 1) / square if square > _TINY else -mpf(1) / 2 + square / 24


def _logarithm(square: mpf) -> mpf:
    f = sqrt(abs(square))
    return 2 * atanh(f) / f / log(2) if square > _TINY else 2 / log(2) * (1 + square / 3)


def _cosine_beyond_square(square: mpf) -> mpf:
    return (_cosine(square) + mpf(1) / 2) / square if square > _TINY else mpf(1) / 24 - square / 720


def _exponential(x: mpf) -> mpf:
    return (exp(x) - 1 - x) / x**2 if abs(x) > _TINY else mpf(1) / 2 + x / 6


def _logarithm_beyond_line(square: mpf) -> mpf:
    return (
        (_logarithm(square) - 2 / log(2)) / square
        if square > _TINY
        else 2 / log(2) * (mpf(1) / 3 + square / 5)
    )


def _arctangent(square: mpf) -> mpf:
    a = sqrt(abs(square))
    return (atan(a) / a - 1) / square if square > _TINY else -mpf(1) / 3 + square / 5


def _hyperbolic_tangent(square: mpf) -> mpf:
    a = sqrt(abs(square))
    return (tanh(a) / a - 1) / square if square > _TINY else -mpf(1) / 3 + 2 * square / 15


if __name__ == "__main__":
    for name, (coefficients, error) in (fits() | single_fits()).items():
        print(f"{name}, error {error}:")
        print("".join(f"    {c!s},\n" for c in coefficients))

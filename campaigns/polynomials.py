"""The polynomials of `ballbot.mechanics.engine.elementary`: Chebyshev fits in forty digits.

.venv/bin/python -m campaigns.polynomials          prints coefficients and their largest errors
"""

from __future__ import annotations

from collections.abc import Callable

from mpmath import atanh, chebyfit, cos, log, mp, mpf, nstr, pi, sin, sqrt

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


if __name__ == "__main__":
    for name, (coefficients, error) in fits().items():
        print(f"{name}, error {error}:")
        print("".join(f"    {c!r},\n" for c in coefficients))

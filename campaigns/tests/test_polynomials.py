"""The polynomials of compiled code."""

import pytest

from ballbot.mechanics.engine import elementary


def test_the_polynomials_are_those_of_the_command():
    pytest.importorskip("mpmath", reason="mpmath, which SymPy brings, is not installed")
    from campaigns.polynomials import fits

    for name, (coefficients, _) in fits().items():
        assert getattr(elementary, name) == tuple(coefficients), name

"""A linear model x_dot = A x + B u, x = [q, q_dot], and how it is handed to python-control."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError

if TYPE_CHECKING:
    from control import StateSpace


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModel:
    """x_dot = A x + B u about upright at psi = 0; x = [x y theta phi psi and their rates], u = wheel torques [N m]."""

    A: NDArray[np.float64]  #: (10, 10)
    B: NDArray[np.float64]  #: (10, n)

    def poles(self) -> NDArray[np.complex128]:
        """Return the eigenvalues of A (10,) [rad/s], the largest real part first."""
        poles = np.asarray(np.linalg.eigvals(self.A), dtype=np.complex128)
        return poles[np.argsort(-np.real(poles), kind="stable")]

    def to_control(self) -> StateSpace:
        """Return the model as a python-control StateSpace with all states as outputs.

        Raises
        ------
        InputError
            Where python-control is not installed.
        """
        try:
            from control import StateSpace
        except ImportError:
            raise InputError(
                "python-control is not installed; install it with: pip install 'ballbot[interop]'."
            ) from None
        return StateSpace(self.A, self.B, np.eye(len(self.A)), np.zeros_like(self.B))

"""The convex step's minimiser against a reference solver's on 10,000 random problems.

.venv/bin/python -m campaigns.evidence convex_step
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import clarabel
import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.stick_slip import minimise
from campaigns.convex_problems import KINDS, Problem, distance, random_problem, with_minimiser
from campaigns.convex_reference import reference
from campaigns.section import Section

#: for each of 3 and 4 wheels, with and without a ball that pivots: 4 x (5 x 400 + 500) = 10,000
OF_A_KIND = 400
MADE = 500
TARGET = 1e-10


@dataclass(frozen=True, kw_only=True)
class Compared:
    """Distances of one problem, over |nu_free|, in the norm of the kinetic energy."""

    ours: float  #: to the refined reference, or to the minimiser that the problem was made around
    bound: float  #: of the reference to the minimiser, proven
    conic: float  #: of Clarabel's own answer to it


def compare(problem: Problem, rng: np.random.Generator, known: NDArray[np.float64] | None = None) -> Compared:
    """Return how far the minimiser that is found is from the reference; the guess of signs is chance's."""
    nu = minimise(*problem, rng.normal(size=len(problem.free)))
    found = reference(problem)
    return Compared(
        ours=distance(problem, nu, found.nu if known is None else known),
        bound=found.bound,
        conic=distance(problem, found.conic, found.nu),
    )


def campaign() -> Section:
    """Return the worst distances of each kind of problem."""
    rng = np.random.default_rng(41)

    def drawn(make: Callable[[int, bool], Compared], count: int) -> list[Compared]:
        return [make(n, pivots) for n in (3, 4) for pivots in (False, True) for _ in range(count)]

    table = {
        kind: drawn(
            lambda n, pivots, kind=kind: compare(
                random_problem(rng, wheel_count=n, pivoting=pivots, kind=kind), rng
            ),
            OF_A_KIND,
        )
        for kind in KINDS
    }

    def made(n: int, pivots: bool) -> Compared:
        problem, known = with_minimiser(rng, wheel_count=n, pivoting=pivots)
        return compare(problem, rng, known)

    table["made around a known minimiser"] = drawn(made, MADE)
    total = sum(len(results) for results in table.values())
    worst = max(one.ours for results in table.values() for one in results)
    return Section(
        title=f"The convex step's minimiser on {total:,} random problems",
        before="Distance of the velocities found to the reference's, over that of the friction-free ones, "
        f"sqrt(nu^T M nu); the target is {TARGET:g}. The reference is Clarabel {clarabel.__version__}'s answer, "
        "refined and certified (`campaigns/convex_reference.py`): it proves how far it is from the minimiser at "
        "most. Three and four wheels, with and without a ball that pivots, a quarter each; attitudes, inertias (a "
        "tenth to ten times the thesis's robot's) and the guess of the signs are random.",
        columns=["problems", "number", "worst", "median", "reference proven to", "Clarabel alone, median"],
        rows=[_row(kind, results) for kind, results in table.items()],
        after=f"Worst of all: {worst:.1e}. Clarabel stops at a duality gap of 1e-13, which bounds the square of the "
        "distance; the worst of its own answers is off by "
        f"{max(one.conic for results in table.values() for one in results):.1e}.",
    )


def _row(kind: str, results: list[Compared]) -> list[str]:
    ours, bound, conic = (
        np.array([getattr(one, name) for one in results]) for name in ("ours", "bound", "conic")
    )
    return [
        kind,
        f"{len(results):,}",
        f"{ours.max():.1e}",
        f"{np.median(ours):.1e}",
        f"{bound.max():.1e}",
        f"{np.median(conic):.1e}",
    ]

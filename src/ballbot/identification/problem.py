"""What a search makes small: windows, a predictor of them, and the parameters as the search sees them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.coordinates import Coordinates
from ballbot.identification.pieces import Differences, Work, normal_equations, square_sums
from ballbot.identification.prediction import Cost, Predictor, chunks
from ballbot.identification.spread import Spread, Threads
from ballbot.identification.windows import Windows

#: half the central difference, in the scaled coordinate; wide enough to average over single sticking steps
DIFFERENCE = 2e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class NormalEquations:
    """The weighted least-squares problem about a point, in scaled coordinates."""

    matrix: NDArray[np.float64]  #: H = sum J^T J (p, p)
    scores: NDArray[np.float64]  #: J^T r of each window (w, p); their sum is the gradient


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Windows to fit and how. A point (p,) holds every parameter of `coordinates`, held ones too, scaled."""

    predictor: Predictor
    windows: Windows
    coordinates: Coordinates
    cost: Cost
    spread: Spread = field(default_factory=Threads)  #: where the work is done

    def costs(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the costs (sets,) of scaled parameters (sets, p)."""
        return self.cost(self.square_sums(points))

    def square_sums(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sums of squares (sets, 10) of scaled parameters (sets, p), over windows and time."""
        return square_sums(self._work, self.coordinates.physical(points), self.spread)

    def residuals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return predicted minus measured states (sets, w, k, 10) at each window's k times of comparison."""
        every = self.windows.comparison_interval
        values = self.coordinates.physical(points)
        parts = [self.predictor.residuals(values, chunk, every=every) for chunk in chunks(self.windows)]
        return np.concatenate(parts, axis=1)

    def resampled(self, rows: NDArray[np.int64]) -> Problem:
        """Return the problem of the windows of those numbers, some of them more than once, at the same cost's scale."""
        return replace(self, windows=self.windows.take(rows))

    def linearize(self, point: NDArray[np.float64]) -> NormalEquations:
        """Return the normal equations about `point` (p,); zero for parameters that are held."""
        size, every = len(point), self.windows.comparison_interval
        moved = np.flatnonzero(self.coordinates.free)
        step = DIFFERENCE * np.eye(size)[moved]
        forward, backward = np.clip(point + step, 0.0, 1.0), np.clip(point - step, 0.0, 1.0)
        distance = (forward - backward)[np.arange(len(moved)), moved]
        values = self.coordinates.physical(np.concatenate([point[None], forward, backward]))
        compared = len(self.windows) * (self.windows.samples // every)
        weight = self.cost.weights(self.square_sums(point[None])[0], compared)
        differences = Differences(values=values, distance=distance, weight=weight)
        part, score = normal_equations(self._work, differences, self.spread)
        matrix, scores = np.zeros((size, size)), np.zeros((len(self.windows), size))
        matrix[np.ix_(moved, moved)], scores[:, moved] = part, score
        return NormalEquations(matrix=matrix, scores=scores)

    @property
    def _work(self) -> Work:
        return Work(predictor=self.predictor, windows=self.windows)

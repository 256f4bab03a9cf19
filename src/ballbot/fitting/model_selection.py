"""Selection of a model among nested ones.

Candidates are nested: each has another one within it, or none. All are fitted to the same windows and predict the same
ones held out. The gain of one over another is the share by which its error is smaller: one less the geometric mean over
states of the ratios of root mean square errors. Its interval is that of a paired bootstrap: blocks of neighbouring
windows are drawn anew, the same for both models, so that what both find hard does not widen it (H. R. Kuensch, The
jackknife and the bootstrap for general stationary observations, Annals of Statistics 17 (1989) 1217-1241). A model is
accepted if the whole interval is above zero, over the model within it and, if that one was not accepted, over the
largest one within that was. The accepted model of the least held-out error is the best. A model is rejected if an
interval lies below a useful gain of 1 %; if it does neither, the data cannot decide.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.uncertainty import resamples

Model = TypeVar("Model")

#: bootstrap draws of a gain, and the confidence of its interval
DRAWS, LEVEL = 4000, 0.95
#: a gain below this is of no use, whatever its significance
USEFUL_GAIN = 0.01

#: of a model: "rejected" only if the interval of its gain excludes a useful one
Decision = Literal["accepted", "rejected", "undecided"]
_SEED = 0


@dataclass(frozen=True, kw_only=True)
class Gain:
    """By which share a model's held-out error is below another's; negative if it is above."""

    share: float
    lower: float  #: of the 95 % interval
    upper: float

    @property
    def significant(self) -> bool:
        """Whether the whole interval is above zero."""
        return self.lower > 0.0

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {"share": self.share, "interval_95": [self.lower, self.upper]}


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOut(Generic[Model]):
    """A fitted model and its errors on windows that it was not fitted to."""

    model: Model
    squares: NDArray[np.float64]  #: (w, k), sums of squared errors of each window and state
    baseline: (
        NDArray[np.float64] | None
    )  #: (w, k), of what no model is within; None if there is no such prediction
    groups: Sequence[NDArray[np.int64]]  #: windows that are drawn together; see `neighbours`


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate(Generic[Model]):
    """One of the models to select from."""

    name: str
    within: str | None  #: the model that it contains and is compared with
    held_out: HeldOut[Model]
    gain: Gain | None  #: over the model within it; None if there is nothing to compare with
    over: str | None  #: the largest accepted model within it, if that is not `within`
    gain_over: Gain | None  #: over that one
    error: float  #: root mean square, over the baseline's if there is one; the geometric mean over states

    @property
    def model(self) -> Model:
        """The fitted model."""
        return self.held_out.model

    @property
    def accepted(self) -> bool:
        """Whether the held-out windows support it."""
        return all(gain is None or gain.significant for gain in (self.gain, self.gain_over))

    @property
    def decision(self) -> Decision:
        """Whether the held-out windows support it, exclude a useful gain, or cannot decide."""
        if self.accepted:
            return "accepted"
        useless = any(gain and gain.upper < USEFUL_GAIN for gain in (self.gain, self.gain_over))
        return "rejected" if useless else "undecided"


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelSelection(Generic[Model]):
    """All candidates, and the best one."""

    candidates: tuple[Candidate[Model], ...]
    best: Candidate[Model]  #: of those accepted, the one with the least error

    def find(self, name: str) -> Candidate[Model]:
        """Return the candidate of that name."""
        return next(one for one in self.candidates if one.name == name)


def select_model(
    within: Mapping[str, str | None],
    fit: Callable[[str, Model | None], HeldOut[Model]],
    *,
    eligible: Collection[str] | None = None,
) -> ModelSelection[Model]:
    """Fit nested models and select the best one.

    Parameters
    ----------
    within : mapping of str to str or None
        The models' names in rising order, each with that of the model within it.
    fit : callable
        From a name and the fitted model within it to the fitted model and its held-out errors, on the same windows
        each time.
    eligible : collection of str, optional
        Which models may be the best one; all by default.
    """
    found: dict[str, Candidate[Model]] = {}
    for name, inner in within.items():
        held_out = fit(name, found[inner].model if inner else None)
        over = _highest_accepted(inner, found)
        found[name] = Candidate(
            name=name,
            within=inner,
            held_out=held_out,
            gain=_gain(held_out, inner, found),
            over=over,
            gain_over=_gain(held_out, over, found),
            error=_error(held_out),
        )
    candidates = tuple(found.values())
    accepted = [one for one in candidates if one.accepted and (eligible is None or one.name in eligible)]
    best = min(accepted, key=lambda one: one.error, default=candidates[0])
    return ModelSelection(candidates=candidates, best=best)


def gain_between(
    squares: NDArray[np.float64], others: NDArray[np.float64], groups: Sequence[NDArray[np.int64]]
) -> Gain:
    """Return the gain of one model over another.

    Parameters
    ----------
    squares, others : ndarray (w, k)
        Sums of squared errors of each window and state, of the one and of the other.
    groups : sequence of ndarray
        Which windows are drawn together.
    """
    counts = resamples(len(groups), block=1, repeats=DRAWS, seed=_SEED)
    ours, theirs = (np.stack([table[rows].sum(axis=0) for rows in groups]) for table in (squares, others))
    with np.errstate(invalid="ignore"):  # predictions without a value have no gain
        draws = 1.0 - _error_ratio(counts @ ours, counts @ theirs)
    tail = 0.5 * (1.0 - LEVEL)
    lower, upper = np.quantile(draws, [tail, 1.0 - tail])
    share = 1.0 - _error_ratio(squares.sum(axis=0), others.sum(axis=0))
    return Gain(share=float(share), lower=float(lower), upper=float(upper))


def neighbours(rows: Sequence[int], *, block: int) -> list[NDArray[np.int64]]:
    """Return the numbers of windows that follow one another, `block` of them at a time."""
    return [np.array(rows[first : first + block], dtype=np.int64) for first in range(0, len(rows), block)]


def _gain(held_out: HeldOut[Model], other: str | None, found: Mapping[str, Candidate[Model]]) -> Gain | None:
    others = found[other].held_out.squares if other else held_out.baseline
    return None if others is None else gain_between(held_out.squares, others, held_out.groups)


def _highest_accepted(name: str | None, found: Mapping[str, Candidate[Model]]) -> str | None:
    while name is not None and not found[name].accepted:
        name = found[name].within
    return name


def _error(held_out: HeldOut[Model]) -> float:
    squares, baseline = held_out.squares, held_out.baseline
    if baseline is None:
        return float(np.exp(0.5 * np.log(squares.mean(axis=0)).mean()))
    return float(_error_ratio(squares.sum(axis=0), baseline.sum(axis=0)))


def _error_ratio(squares: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the geometric mean over states (..., k) of the ratios of root mean square errors."""
    tiny = np.finfo(float).tiny
    return np.exp(0.5 * np.log((squares + tiny) / (others + tiny)).mean(axis=-1))

"""The ladder of friction laws, and the choice of one by its error on windows held out.

The ladder of friction laws, each of which has the ones before it within it.

    none                 0
    viscous              b w
    coulomb              b w + c sgn(w)                                        and the ball's rolling friction C_rr
    stribeck             b w + (c + s exp(-|w/v_s|^delta)) sgn(w)              the thesis's law (3.8)
    asymmetric           the same, and a torque offset o of each wheel
    load                 the same as stribeck with c + mu |u| in place of c

Asymmetric. Let wheel i have dry friction c+ while it turns forward and c- while it turns backward, and at rest hold
any torque from -c- to c+. With c = (c+ + c-)/2 and o = (c+ - c-)/2 that is c sgn(w) + o:

    forward   c + o = c+          backward  -c + o = -c-          at rest   [-c, c] + o = [-c-, c+]

So it is the symmetric law and a constant torque -o on the wheel, the set of torques that hold it at rest included, and
the same holds with s exp(..) added to c on both sides. The offset is found as `torque_offset` (= -o): a motor driver's
own offset has the same effect, and no log tells one from the other. It is physical while |o| <= c. A viscous part that
differs with direction is another law, of |w|, and not in it.

Load. A gear's teeth rub in proportion to what they carry, here the motor's torque u, which is held over a sample; so is
then the friction's size. It stands beside asymmetric on the ladder, not above it: both have stribeck within them.

Climbing the ladder of friction laws: a rung is taken only where it earns its place on windows held out.

Each law is fitted to the same windows and predicts the same ones held out. Its gain over another is the share by which
the error falls: one less the geometric mean over states of the ratios of root mean square errors. The interval is a
bootstrap's, paired: windows are drawn anew in blocks of neighbours, the same for both laws, so that what both find
hard does not widen it (H. R. Kuensch, The jackknife and the bootstrap for general stationary observations, Annals of
Statistics 17 (1989) 1217-1241). A rung is taken where the whole interval is above zero, over the law within it and,
where that was not taken, over the highest that was.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, suggest
from ballbot.identification.parameters import Bounds
from ballbot.identification.quantities import FRICTION, Limits
from ballbot.identification.result import Identification
from ballbot.identification.stages import states_counted
from ballbot.identification.windows import Span

LawName = Literal["viscous", "coulomb", "stribeck", "asymmetric", "load"]

_NO_STRIBECK: dict[str, Limits] = {
    "stribeck": (0.0, 0.0),
    "stribeck_speed": (1.0, 1.0),
    "stribeck_exponent": (1.0, 1.0),
}


@dataclass(frozen=True, kw_only=True)
class Law:
    """A rung of the ladder."""

    name: LawName
    formula: str
    within: LawName | None  #: the rung that it contains and is compared with; None: no friction
    sought: tuple[str, ...]  #: quantities
    held: Mapping[str, Limits]  #: quantities of `FRICTION` that it does not have, at values without effect
    #: bounds where none are given: without dry friction, b has to do its part
    wide: Mapping[str, Limits] = field(default_factory=dict[str, Limits])


LAWS: tuple[Law, ...] = (
    Law(
        name="viscous",
        formula="b w",
        within=None,
        sought=("viscous",),
        held={**_NO_STRIBECK, "coulomb": (0.0, 0.0), "rolling": (0.0, 0.0)},
        wide={"viscous": (0.0, 1.0)},
    ),
    Law(
        name="coulomb",
        formula="b w + c sgn w, rolling C_rr",
        within="viscous",
        sought=("viscous", "coulomb", "rolling"),
        held=_NO_STRIBECK,
    ),
    Law(
        name="stribeck",
        formula="b w + (c + s exp(-|w/v_s|^delta)) sgn w, C_rr",
        within="coulomb",
        sought=FRICTION,
        held={},
    ),
    Law(
        name="asymmetric",
        formula="stribeck, c and s of either direction",
        within="stribeck",
        sought=(*FRICTION, "torque_offset"),
        held={},
    ),
    Law(
        name="load",
        formula="stribeck, c + mu |u|",
        within="stribeck",
        sought=(*FRICTION, "load"),
        held={},
    ),
)


def law_named(name: str) -> Law:
    """Return the law of that name.

    Raises
    ------
    InputError
        Where there is none.
    """
    names = [law.name for law in LAWS]
    if name in names:
        return LAWS[names.index(name)]
    hint = suggest(name, names, otherwise="there are")
    raise InputError(f"{name!r} is not a friction law; {hint}")


def bounds_of(law: Law, bounds: Bounds) -> Bounds:
    """Return bounds that hold what the law does not have; the rest stay as given."""
    given = {name: bounds.interval(name) for name in bounds.given}
    return Bounds(**{**law.wide, **given, **law.held})


#: neighbouring windows drawn together; of a quarter held out, four are some 4 s of the robot's way
BLOCK = 4
DRAWS = 4000
#: of the interval
LEVEL = 0.95
_SEED = 0


@dataclass(frozen=True, kw_only=True)
class Gain:
    """By which share a law's error on windows held out is below another's; negative where it is above."""

    share: float
    lower: float  #: of the 95 % interval
    upper: float

    @property
    def sure(self) -> bool:
        """Whether the whole interval is above zero."""
        return self.lower > 0.0

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {"share": self.share, "interval_95": [self.lower, self.upper]}


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A law on the ladder."""

    law: Law
    found: Identification
    gain: Gain  #: over the law within it, `law.within`
    #: over the highest rung taken below it, which is another one where the law within it is not taken
    over: LawName | None
    gain_over: Gain
    error: float  #: geometric mean of the ratios of errors on windows held out to those without friction

    @property
    def taken(self) -> bool:
        """Whether it earns its place."""
        return self.gain.sure and self.gain_over.sure

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "law": self.law.name,
            "formula": self.law.formula,
            "within": self.law.within,
            "gain": self.gain.to_dict(),
            "highest_taken_below": self.over,
            "gain_over_highest_taken": self.gain_over.to_dict(),
            "taken": self.taken,
            "error_over_no_friction": self.error,
            "parameters": self.found.to_dict()["parameters"],
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelSelection:
    """All laws, and the one to take."""

    rungs: tuple[Candidate, ...]
    best: Candidate  #: the last taken; of rungs that stand side by side, the one with the smaller error

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {"rungs": [rung.to_dict() for rung in self.rungs], "best": self.best.law.name}


#: from a law and the identification to begin from, to an identification by that law
Fit = Callable[[LawName, Identification | None], Identification]


def select_model(fit: Fit) -> ModelSelection:
    """Fit every law and see which earn their place.

    Parameters
    ----------
    fit : callable
        Calls `ballbot.identification.identify` with its law and `start`, all else the same each time:
        climb(lambda law, start: identify(robot, logs, law=law, start=start))
    """
    rungs: dict[LawName, Candidate] = {}
    for law in LAWS:
        found = fit(law.name, rungs[law.within].found if law.within else None)
        counted = states_counted(found.left_out)
        over = _highest_accepted(law, rungs)
        groups = window_blocks(found.held_out_windows)
        squares: dict[LawName | None, NDArray[np.float64]] = {
            name: rung.found.held_out.squares_with[:, counted] for name, rung in rungs.items()
        }
        ours, none = found.held_out.squares_with[:, counted], found.held_out.squares_without[:, counted]
        squares[None] = none
        rungs[law.name] = Candidate(
            law=law,
            found=found,
            gain=gain_between(ours, squares[law.within], groups),
            over=over,
            gain_over=gain_between(ours, squares[over], groups),
            error=float(_error_ratio(ours.sum(axis=0), none.sum(axis=0))),
        )
    taken = [rung for rung in rungs.values() if rung.taken] or [rungs[LAWS[0].name]]
    side_by_side = [rung for rung in taken if rung.law.within == taken[-1].law.within]
    return ModelSelection(rungs=tuple(rungs.values()), best=min(side_by_side, key=lambda rung: rung.error))


def gain_between(
    squares: NDArray[np.float64], others: NDArray[np.float64], groups: list[NDArray[np.int64]]
) -> Gain:
    """Return the gain of one law over another.

    Parameters
    ----------
    squares, others : ndarray (w, k)
        Sums of squared errors of each window and state, of the one and of the other.
    groups : list of ndarray
        Which windows are drawn together; see `blocks`.
    """
    drawn = np.random.default_rng(_SEED).integers(len(groups), size=(DRAWS, len(groups)))
    counts = np.stack([np.bincount(row, minlength=len(groups)) for row in drawn]).astype(float)
    ours, theirs = (np.stack([table[rows].sum(axis=0) for rows in groups]) for table in (squares, others))
    draws = 1.0 - _error_ratio(counts @ ours, counts @ theirs)
    tail = 0.5 * (1.0 - LEVEL)
    lower, upper = np.quantile(draws, [tail, 1.0 - tail])
    share = 1.0 - _error_ratio(squares.sum(axis=0), others.sum(axis=0))
    return Gain(share=float(share), lower=float(lower), upper=float(upper))


def window_blocks(spans: Sequence[Span]) -> list[NDArray[np.int64]]:
    """Return the numbers of windows, `BLOCK` neighbours of one log at a time."""
    groups = []
    for log in sorted({span.log for span in spans}):
        rows = [row for row, span in enumerate(spans) if span.log == log]
        rows.sort(key=lambda row: spans[row].start)
        groups += [np.array(rows[first : first + BLOCK]) for first in range(0, len(rows), BLOCK)]
    return groups


def _highest_accepted(law: Law, rungs: dict[LawName, Candidate]) -> LawName | None:
    within = law.within
    while within is not None and not rungs[within].taken:
        within = rungs[within].law.within
    return within


def _error_ratio(squares: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the geometric mean over states (..., k) of the ratios of root mean square errors."""
    tiny = np.finfo(float).tiny
    return np.exp(0.5 * np.log((squares + tiny) / (others + tiny)).mean(axis=-1))

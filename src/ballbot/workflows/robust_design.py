"""LQR weights chosen by search over perturbed robots, for the worst tenth of them and not the mean.

The search is an evolution over the logarithms of the state weights, every generation one batch. The torque weight
stays the nominal one, since only ratios matter. x and y, theta and phi, and their rates share a weight each, which
leaves six; the middle of the search is the nominal gain, its ends a hundredth and a hundred times its weights. Every
candidate runs on the same perturbed robots, so that candidates differ by what they do and not by luck.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import MOST_TRIALS
from ballbot.control.controller import Compensation, Controller
from ballbot.control.lqr import LqrDesign, gain_rows
from ballbot.control.margins import Margins, loop_margins
from ballbot.control.presets import NOMINAL_STATE_WEIGHTS, NOMINAL_TORQUE_WEIGHT, design_gain
from ballbot.errors import InputError
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.search import evolve
from ballbot.progress import Progress
from ballbot.results import key, left_out
from ballbot.robot import RobotLike, as_robot
from ballbot.summary import Summary, listed, plotted, summarized
from ballbot.twin.scenario import Scenario
from ballbot.workflows.perturbed_robots import (
    CostUnits,
    PerturbationRanges,
    RunMeasures,
    cost_units,
    draw_perturbed,
    measure_runs,
    worst_tenth,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: places of the state that share a weight
GROUPS = ((0, 1), (2, 3), (4,), (5, 6), (7, 8), (9,))
#: decades to either side of the nominal weights
DECADES = 2.0
_NO_GAIN = 100.0  # the cost of weights that have none


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much is tried.

    Raises
    ------
    InputError
        If a number is below its minimum or above the largest number of trials.
    """

    robots: int = 200  #: perturbed robots on which every candidate runs
    generations: int = 30
    population: int = 12  #: candidates of a generation
    fresh: int = 500  #: other robots on which what was found is compared

    def __post_init__(self) -> None:
        for name, least in (("robots", 10), ("generations", 1), ("population", 4), ("fresh", 10)):
            if getattr(self, name) < least:
                raise InputError(
                    f"The number of {name} is {getattr(self, name)}; it must be at least {least}."
                )
            if getattr(self, name) > MOST_TRIALS:
                raise InputError(
                    f"The number of {name} is {getattr(self, name)}; it must be {MOST_TRIALS} or less."
                )


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedDesign:
    """How one design does on the fresh robots."""

    state_weights: tuple[float, ...]
    torque_weight: float
    gain: NDArray[np.float64]
    worst_tenth: float  #: of J
    mean: float  #: of J
    worst_error: float  #: mean of the largest tenth of the settled errors of those that stood [m]
    worst_roughness: float  #: the same of the torque's change [N m]
    falls: int
    costs: NDArray[np.float64] = field(metadata=left_out)  #: (fresh robots,) J of each


@summarized
@dataclass(frozen=True, kw_only=True, eq=False)
class RobustDesign:
    """A gain found by search over perturbed robots, compared with others."""

    design: LqrDesign = field(metadata=left_out)
    controller: Controller = field(metadata=left_out)
    state_weights: tuple[float, ...]
    torque_weight: float
    units: CostUnits  #: what J is counted in
    history: tuple[float, ...]  #: best worst tenth after each generation, on the robots of the search
    #: "robust", "nominal" and "plain", on robots that the search did not use
    compared: dict[str, ComparedDesign] = field(metadata=key("on_fresh_robots"))
    fresh: int = field(metadata=key("fresh_robots"))  #: number of these robots
    spread: PerturbationRanges = field(metadata=key("perturbed"))
    scenario: str  #: its name

    @cached_property
    def loop_margins(self) -> Margins:
        """The margins of the loop."""
        return loop_margins(self.controller)

    def summary(self) -> Summary:
        """Return the gain, its weights, and how it compares with others on robots that the search did not use."""
        compared = (
            (name, f"worst tenth of J {one.worst_tenth:.3g}, mean {one.mean:.3g}, falls {one.falls}")
            for name, one in self.compared.items()
        )
        return Summary(
            title=f"Robust LQR gain, compared on {self.fresh} perturbed robots",
            rows=(
                *compared,
                ("Q", f"diag({listed(self.state_weights)})"),
                ("R", f"{self.torque_weight:.3g} I"),
                *gain_rows(self.controller.gain),
            ),
        )

    def plot(self) -> Figure:
        """Return a figure of the search, and of each design's costs on robots that it did not use."""
        return plotted(self)


def robust_design(
    robot: RobotLike,
    *,
    compensation: Compensation,
    spread: PerturbationRanges,
    scenario: Scenario,
    effort: Effort,
    run: Run = DEFAULT_RUN,
    threads: int | None = None,
) -> RobustDesign:
    """Search for the weights whose worst tenth over perturbed robots is best, and compare them on fresh robots.

    Parameters
    ----------
    robot : Robot, preset or robot file
        The nominal one: the gain is designed for it, and its friction is compensated.
    compensation : {"none", "full", "partial"}
    spread : PerturbationRanges
    scenario : Scenario
        Sensors, drive and play of all robots.
    effort : Effort
    run : Run, optional
        Its seed fixes the result bit for bit.
    threads : int, optional
        All cores by default; the result does not depend on it.

    Raises
    ------
    InputError
        If the nominal gain falls with half of the perturbed robots, or the seed is invalid.
    """
    robot = as_robot(robot)
    perturbed = draw_perturbed(robot, effort.robots, spread=spread, scenario=scenario, seed=run.seed)

    def controller_of(weights: tuple[float, ...], torque_weight: float = NOMINAL_TORQUE_WEIGHT) -> Controller:
        gain = design_gain(robot, state_weights=weights, torque_weight=torque_weight).gain
        return Controller(robot, gain, compensation=compensation, estimator="kalman")

    units = cost_units(measure_runs([controller_of(NOMINAL_STATE_WEIGHTS)], perturbed, threads=threads))

    def cost_of(candidates: NDArray[np.float64]) -> NDArray[np.float64]:
        costs = np.full(len(candidates), _NO_GAIN)
        made: dict[int, Controller] = {}
        for place, candidate in enumerate(candidates):
            try:
                made[place] = controller_of(weights_of(candidate))
            except InputError:
                continue  # weights so far apart that the equations have no solution in these digits
        if made:
            marks = measure_runs(list(made.values()), perturbed, threads=threads)
            costs[list(made)] = worst_tenth(units.costs(marks))
        return costs

    def report(now: Progress) -> None:
        run.progress(replace(now, note=f"worst tenth {now.cost:.2f}"))

    found = evolve(
        cost_of,
        size=len(GROUPS),
        generations=effort.generations,
        population=effort.population,
        run=replace(run, progress=report),
    )
    weights = weights_of(found.best)
    designs = {
        "robust": (weights, NOMINAL_TORQUE_WEIGHT),
        "nominal": (NOMINAL_STATE_WEIGHTS, NOMINAL_TORQUE_WEIGHT),
        "plain": ((1.0,) * 10, 1.0),
    }
    run.progress(Progress(stage="comparison"))
    fresh = draw_perturbed(robot, effort.fresh, spread=spread, scenario=scenario, seed=run.seed + 1_000_003)
    controllers = {name: controller_of(*one) for name, one in designs.items()}
    marks = measure_runs(list(controllers.values()), fresh, threads=threads)
    compared = {
        name: _compared_design(designs[name], controller, marks, units, place)
        for place, (name, controller) in enumerate(controllers.items())
    }
    return RobustDesign(
        design=design_gain(robot, state_weights=weights),
        controller=controllers["robust"],
        state_weights=weights,
        torque_weight=NOMINAL_TORQUE_WEIGHT,
        units=units,
        history=found.history,
        compared=compared,
        fresh=effort.fresh,
        spread=spread,
        scenario=scenario.name,
    )


def weights_of(candidate: NDArray[np.float64]) -> tuple[float, ...]:
    """Return the ten state weights of a point (6,) of the unit cube."""
    weights = np.array(NOMINAL_STATE_WEIGHTS)
    for group, place in zip(GROUPS, candidate, strict=True):
        weights[list(group)] *= 10.0 ** (DECADES * (2.0 * float(place) - 1.0))
    return tuple(weights.tolist())


def _compared_design(
    weights: tuple[tuple[float, ...], float],
    controller: Controller,
    marks: RunMeasures,
    units: CostUnits,
    place: int,
) -> ComparedDesign:
    stood, costs = ~marks.fell[place], units.costs(marks)[place]
    return ComparedDesign(
        state_weights=tuple(weights[0]),
        torque_weight=weights[1],
        gain=controller.gain,
        worst_tenth=float(worst_tenth(costs)),
        mean=float(costs.mean()),
        worst_error=float(worst_tenth(marks.error[place, stood])) if stood.any() else float("nan"),
        worst_roughness=float(worst_tenth(marks.roughness[place, stood])) if stood.any() else float("nan"),
        falls=int((~stood).sum()),
        costs=costs,
    )

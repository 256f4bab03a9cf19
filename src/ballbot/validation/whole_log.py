"""Closed-loop runs of both models over a whole log: could the log be one of the runs?

Over a whole log the phases of model and robot drift apart, because friction makes both wander in a limit cycle whose
period depends on the smallest differences. A single run therefore says little. Here the compiled loop makes `RUNS` runs
of each model with the log's reference and controller, and compares three numbers of each state that do not depend on
the phase: the RMS of its deviation from the reference, and the amplitude and the period of its swings.

The runs have the robot's play, rollers and sensors, and the estimator that the controller is made for: encoders on the
motors see the play. They differ by the sensors' noise, by that of the initial state, by where the motors are within the
play and by which roller touches first. Friction that contains the rollers' losses counts them twice here.

If the log is one more run of the model, each of its numbers falls into each of the 200 gaps between and beyond those of
199 runs with the same probability: between the 5th and the 195th with 190 / 200, 95 %, whatever the distribution.
"""

from dataclasses import dataclass, replace

import numpy as np

from ballbot.arrays import Floats, Ints
from ballbot.control.controller import Controller
from ballbot.robot import Robot
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Imperfections, RollerContacts
from ballbot.validation.models import (
    RUNS,
    Case,
    Comparison,
    Trajectories,
    by_model,
    by_state,
    keys_of,
    stretches,
)

_RANKS = (5, 100, 195)  #: of the ends of the range that contains 95 % of runs, and of the median
QUANTITIES = ("rms", "amplitude", "period")
#: longest part of a log that is compared [s]: the work grows with its length
_LONGEST = 100.0
#: interval between the rows that are compared [s]; the period of a limit cycle is seconds
_ROW_TIME = 0.02
#: inner step of the models, if theirs is shorter [s]: the medians of the three numbers agree with those of 1 ms within
#: 1.5 % (3 % for the periods), in 0.75 of the time
_STEP = 2.5e-3
#: a swing to a side reaches at least so many standard deviations from the mean
_SIDE = 0.5
_EXAMPLE_TIME = 20.0  #: [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class WholeLog(Comparison):
    """One log's and both models' numbers, in the order of `QUANTITIES` and of the states.

    A state that never swings has the amplitude zero and an infinite period. All numbers of a run that ends early, for
    example by a fall, are infinite.
    """

    duration: float  #: of the log's longest interval without a gap, at most 100 s [s]
    measured: Floats  #: (3, 10) of the log
    runs: Floats  #: (2, runs, 3, 10) of the first model's runs and the second's
    fell: tuple[int, int]  #: runs of each model that ended early
    example: Trajectories  #: the beginning of the first run of each

    @property
    def ranges(self) -> Floats:
        """Lower end, median and upper end of the range that contains 95 % of each model's runs (3, 2, 3, 10)."""
        return np.sort(self.runs, axis=1)[:, np.array(_RANKS) - 1].swapaxes(0, 1)

    @property
    def sides(self) -> Ints:
        """Where the log's numbers lie (2, 3, 10): -1 below a model's range, 0 inside, 1 above."""
        lower, _, upper = self.ranges
        return np.where(self.measured < lower, -1, np.where(self.measured > upper, 1, 0))

    @property
    def own_inside(self) -> Ints:
        """In how many of the 30 numbers each of the first model's runs is within the range of the others (runs,)."""
        # without the run itself, the ends are those that are next to the range's
        lower, upper = np.sort(self.runs[0], axis=0)[[_RANKS[0], _RANKS[-1] - 2]]
        return ((self.runs[0] >= lower) & (self.runs[0] <= upper)).sum(axis=(1, 2))

    def verdict(self) -> str:
        """Return in how many states the log lies within the range of each model's runs, and how many runs fell."""
        inside = (self.sides == 0).sum(axis=-1)
        counts = [f"{rms}, {amplitude} and {period}" for rms, amplitude, period in inside.tolist()]
        fell = [
            f" {count} of the {RUNS} runs of the model {name} end early."
            for count, name in zip(self.fell, self.models.names, strict=True)
            if count
        ]
        first, second = self.models.names
        return (
            f"Over {self.duration:.3g} s without a restart, RMS, amplitude and period of the log's deviations from the "
            f"reference lie within the 95 % range of {RUNS} runs of the model {first} in {counts[0]} of the ten "
            f"states, and of the model {second} in {counts[1]}.{''.join(fell)}"
        )

    def results(self) -> dict[str, object]:
        """Return RMS, amplitude and period of the log, and median and range of each model's runs."""
        return {
            "duration": self.duration,
            "runs": RUNS,
            **{
                quantity: {
                    "log": by_state(self.measured[k]),
                    **by_model("median_", self.models, self.ranges[1, :, k]),
                    **by_model("range_95_", self.models, self.ranges[::2, :, k].swapaxes(0, 1)),
                }
                for k, quantity in enumerate(QUANTITIES)
            },
            "ended_early": dict(zip(keys_of(self.models), self.fell, strict=True)),
        }


def compare_whole_log(case: Case, controller: Controller, *, delay: int) -> WholeLog:
    """Run both models over a log's longest interval without a gap, with the controller that recorded it.

    Its torques are delayed by `delay` samples.
    """
    models, log = case.models, case.log
    part = max(stretches(log), key=len)
    every = max(1, round(_ROW_TIME / log.sample_time))
    records = max(1, min(len(part) - 1, round(_LONGEST / log.sample_time)) // every)
    every = min(every, len(part) - 1)
    samples = records * every
    states, references = (
        columns[part.start : part.start + samples + 1] for columns in (log.states, log.reference)
    )
    measured, noise = states[every::every], case.drawn_noise(RUNS)
    runs, fell = [], []
    for model in models.both:
        batch = simulate_batch(
            replace(model, step=max(model.step, _STEP)),
            controller,
            lambda t: references[min(round(t / controller.sample_time), samples)],
            duration=(samples + 1) * controller.sample_time,
            initial_states=states[0] + noise,
            imperfections=_of_robot(model.robot, controller.sample_time, delay=delay, seed=case.seed),
            every=every,
        )
        runs.append(batch.seen[:, 1:])
        fell.append(~batch.survived)
    deviations = np.concatenate([measured[None], *runs]) - references[every::every]
    numbers = np.array([_numbers(deviation, every * log.sample_time) for deviation in deviations])
    numbers[1:][np.concatenate(fell)] = np.inf
    shown = min(records, round(_EXAMPLE_TIME / (every * log.sample_time)))
    return WholeLog(
        models=models,
        duration=samples * log.sample_time,
        measured=numbers[0],
        runs=numbers[1:].reshape(2, RUNS, *numbers.shape[1:]),
        fell=(int(fell[0].sum()), int(fell[1].sum())),
        example=Trajectories.beside(log, part.start, np.array([run[0, :shown] for run in runs]), every=every),
    )


def _of_robot(robot: Robot, sample_time: float, *, delay: int, seed: int) -> Imperfections:
    """Return what a robot file says of play, rollers and sensors; motors without inertia follow their wheels."""
    return Imperfections(
        sensors=replace(robot.sensors, sample_time=sample_time),
        delay=delay,
        backlash=robot.drive.backlash if robot.drive.reflected_inertia > 0.0 else 0.0,
        contacts=RollerContacts(rollers=robot.wheels.rollers, softness=robot.friction.roller_softness or 1.0),
        seed=seed,
    )


def _numbers(deviation: Floats, row_time: float) -> Floats:
    """Return RMS, amplitude and period (3, 10) of a run's deviations from the reference (rows, 10)."""
    swings = np.array([_swings(column) for column in (deviation - deviation.mean(axis=0)).T]).T
    return np.array([np.sqrt(np.mean(deviation**2, axis=0)), swings[0], row_time * swings[1]])


def _swings(values: Floats) -> tuple[float, float]:
    """Return the mean amplitude and the mean period in rows of the swings of values about zero.

    A swing goes from one side to the other, each at least `_SIDE` standard deviations away, so that noise about zero
    is no swing; its amplitude is that of its farthest point.
    """
    away = np.flatnonzero(np.abs(values) > _SIDE * values.std())
    begins = away[1:][np.diff(np.sign(values[away])) != 0.0]
    if len(begins) < 3:  # no whole period
        return 0.0, np.inf
    farthest = np.maximum.reduceat(np.abs(values), begins)[:-1]
    return float(farthest.mean()), 2.0 * float(begins[-1] - begins[0]) / (len(begins) - 1)

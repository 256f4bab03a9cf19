"""Where friction matters: the error over the stiffness of the gain, with and without compensation and observer.

A soft gain wanders by the friction over its position gain; a stiff one leaves little of that to compensate. The gains
lead from the soft one (weights q_0) over the precise controller's (q_1) to where the loop has no margin: with delay,
lag and resonance of the scenario its sensitivity exceeds 2 at some frequency.

    q = q_0^(1 - s) q_1^s

Everything else is the precise controller's, on robots of the choice, on the first part of its course.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import dropwhile, product, takewhile

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Floats
from ballbot.control.controller import Controller
from ballbot.control.linear import robot_loop
from ballbot.control.margins import sensitivity_peak
from ballbot.control.presets import (
    NOMINAL_STATE_WEIGHTS,
    PRECISE_INTEGRAL_WEIGHTS,
    PRECISE_STATE_WEIGHTS,
    design_integral_gain,
    precise_controller,
)
from ballbot.errors import InputError
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.robot import Robot
from ballbot.twin.scenario import Scenario
from ballbot.workflows.controller_choice import ControllerChoice, NamedCourse, Trial, run_trials

#: of the integrals beside the soft weights, so small that the position gain stays within a tenth of the soft one's
_SOFT_INTEGRAL_WEIGHTS = (0.02, 0.02, 0.002)
#: s of the gains: the soft one is 0, the precise controller's 1. At 2.5 the position gain is 450 times the soft one
_STIFFEST, _GAINS = 2.5, 7
#: least s of the stiffest gain, so that a loop without margins is compared, too
_LEAST = 0.5
#: largest sensitivity of a loop with margins: all torques may double or turn by 29 deg
LARGEST_SENSITIVITY = 2.0
#: of the choice's; the median of ten has a 95 % interval from the second to the ninth
_ROBOTS = 10
#: of the course [s]: two sides of the square
_DURATION = 16.0


@dataclass(frozen=True, kw_only=True)
class Variant:
    """The parts of a controller besides its gain."""

    compensation: bool  #: full
    observer: bool  #: the disturbance observer and integral action


VARIANTS = tuple(
    Variant(compensation=has, observer=observes) for has, observes in product((False, True), repeat=2)
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Stiffness:
    """Controllers of one gain."""

    position_gain: float  #: torque of all wheels, root of the sum of squares, for a metre along x [N m/m]
    sensitivity: float  #: largest over the frequencies, of the gain by itself; infinite without stability
    trials: Mapping[Variant, Trial]

    def holds(self, variant: Variant) -> bool:
        """Return whether the gain by itself has margins and no run fell."""
        return self.sensitivity <= LARGEST_SENSITIVITY and not self.trials[variant].falls


@dataclass(frozen=True, kw_only=True, eq=False)
class FrictionByStiffness:
    """The error over the stiffness of the gain."""

    course: NamedCourse
    gains: tuple[Stiffness, ...]  #: the softest first
    precise_gain: float  #: position gain of the precise controller [N m/m]
    margins_end: bool  #: whether a stiffer gain has no margins; else it was not tried

    def stiffest(self, variant: Variant) -> Stiffness | None:
        """Return the stiffest gain up to which all have margins, nothing falls and the error does not clearly grow.

        Growing means that the interval of the median lies above that of a softer gain. None if the softest fails.
        """
        best: Stiffness | None = None
        lowest = np.inf  # upper end of an interval
        for gain in self.gains:
            peak = gain.trials[variant].peak
            if not gain.holds(variant) or peak.low > lowest:
                break
            best, lowest = gain, min(lowest, peak.high)
        return best

    def pays_over(self, *, observer: bool) -> tuple[Stiffness, ...]:
        """Return the first gains in a row at which compensation clearly makes the error smaller and no run fall."""
        without, with_it = (Variant(compensation=has, observer=observer) for has in (False, True))

        def pays(gain: Stiffness) -> bool:
            plain, compensated = gain.trials[without], gain.trials[with_it]
            return compensated.falls <= plain.falls and plain.ratio_to(compensated).low > 1.0

        return tuple(takewhile(pays, dropwhile(lambda gain: not pays(gain), self.gains)))


def measure_stiffness(choice: ControllerChoice, *, run: Run = DEFAULT_RUN) -> FrictionByStiffness:
    """Run gains from soft to where the margins end on the first robots of a choice."""
    base, known = choice.trials["precise"].controller, choice.plants[0].known
    scenario = choice.plants[0].scenario
    course = replace(choice.course, duration=min(choice.course.duration, _DURATION))
    end = _end(base, known, scenario)
    ladder = np.linspace(0.0, end, _GAINS).tolist()
    controllers = {(s, variant): _controller(base, known, s, variant) for s in ladder for variant in VARIANTS}
    trials = run_trials(controllers, course, choice.plants[:_ROBOTS], run=run)
    gains = tuple(
        Stiffness(
            position_gain=_position_gain(controllers[s, VARIANTS[0]]),
            sensitivity=_sensitivity(controllers[s, VARIANTS[0]], scenario),
            trials={variant: trials[s, variant] for variant in VARIANTS},
        )
        for s in ladder
    )
    return FrictionByStiffness(
        course=course, gains=gains, precise_gain=_position_gain(base), margins_end=end < _STIFFEST
    )


def _position_gain(controller: Controller) -> float:
    return float(np.linalg.norm(controller.gain[:, 0]))


def _controller(base: Controller, known: Robot, s: float, variant: Variant) -> Controller:
    weights = _between(NOMINAL_STATE_WEIGHTS, PRECISE_STATE_WEIGHTS, s)
    # beyond the precise gain as the position's: integrals that grow faster would act faster than the robot balances
    stiffer = weights[0] / _between(NOMINAL_STATE_WEIGHTS, PRECISE_STATE_WEIGHTS, min(s, 1.0))[0]
    integral = stiffer * _between(_SOFT_INTEGRAL_WEIGHTS, PRECISE_INTEGRAL_WEIGHTS, min(s, 1.0))
    design = design_integral_gain(
        known,
        state_weights=weights.tolist(),
        integral_weights=integral.tolist(),
        sample_time=base.sample_time,
    )
    controller = precise_controller(
        known,
        compensation="full" if variant.compensation else "none",
        design=design,
        compensated=base.robot.friction,
    )
    if variant.observer:
        return controller
    return controller.with_parts(replace(controller.parts, integral=None, disturbance_observer=None))


def _between(soft: Sequence[float], stiff: Sequence[float], s: float) -> Floats:
    return np.asarray(np.array(soft) ** (1.0 - s) * np.array(stiff) ** s)


def _end(base: Controller, known: Robot, scenario: Scenario) -> float:
    """Return up to which s a gain by itself has margins."""
    end = _LEAST
    while end < _STIFFEST:
        try:
            stiffer = _controller(base, known, end + 0.25, VARIANTS[0])
        except InputError:  # no gain stabilises with these weights
            break
        if _sensitivity(stiffer, scenario) > LARGEST_SENSITIVITY:
            break
        end += 0.25
    return end


def _sensitivity(controller: Controller, scenario: Scenario) -> float:
    """Return a loop's largest sensitivity with the delays, motor lag and resonance of a scenario."""
    timing, motors = scenario.timing, scenario.current_loop
    faults, twist = scenario.sensor_faults, scenario.compliance
    late = (timing.delay * controller.sample_time if timing else 0.0) + (faults.latency if faults else 0.0)

    def passed(omega: Floats) -> NDArray[np.complex128]:
        response = np.exp(-1j * omega * late)
        if motors:
            response = response / (1.0 + 1j * omega / (2.0 * np.pi * motors.bandwidth))
        if twist:
            ratio = omega / (2.0 * np.pi * twist.frequency)
            response = response / (1.0 - ratio**2 + 2j * twist.damping_ratio * ratio)
        return response

    return sensitivity_peak(robot_loop(controller), passed)

"""What the robot file does not know: its errors in the covariance of an estimate, and values that the logs refute.

Masses, lengths, inertias and the scales of torque and time come from the robot file, each with a standard deviation:
the file's, or that of its kind (`DEVIATIONS`, and `Parameter.error`). With the Gauss-Newton equations of the
parameters p and of these values v, in units of their deviations, the best p moves with the values, and with the
correlation R of their errors its covariance grows:

    dp/dv = -H_pp^-1 H_pv,          C + (dp/dv) R (dp/dv)^T

C_rr is found beforehand (`ballbot.identification.rolling`): it depends on v too, and what p changes with it counts.

These are consider parameters (S. Schmidt, Application of state-space methods to navigation problems, Advances in
Control Systems 3 (1966) 293-340): they have priors, but keep the file's values, because what the model lacks would move
them.

The logs' own estimate of a value v is from a linear fit of the parameters, v, and all other values u with their priors,

    (H + w D) d = -g,      error of d_v^2 = w [(H + w D)^-1]_vv,      D = diag(0, 1 for each u)

in which w is how much larger the variances of dependent residuals are than those of independent ones: at least as
clustering by window has it. What the model lacks (play, rollers, delays) shows in how far it pulls the other values
from the file, most of which are right. So w is raised until the sum of their squared pulls is the one that a right
model has on average, with s_u the error of d_u:

    sum_u d_u^2 = sum_u (1 - s_u^2) = n

(D. MacKay, Bayesian interpolation, Neural Computation 4 (1992) 415-447; a Birge ratio, of the other values). A value
that alone is wrong pulls no others once it is free. Student's t with n degrees of freedom judges the difference.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from ballbot.arrays import Bools, Floats
from ballbot.errors import InputError
from ballbot.findings import Finding, error, note
from ballbot.fitting.fit import Fit
from ballbot.fitting.uncertainty import WindowEquations
from ballbot.identification.balancing import Balancing, WindowsIterate
from ballbot.identification.quantities import BY_NAME as QUANTITIES
from ballbot.identification.rolling import FoundRolling
from ballbot.results import reported
from ballbot.robot import Robot
from ballbot.robot.components import BY_NAME
from ballbot.robot.parameters import numbers_of, value_of
from ballbot.robot.variations import STEP, Uncertain, correlations, shifted, uncertain, with_default_errors
from ballbot.rounding import digits

_TORQUE, _CLOCK = "drive.torque_constant", "sensors.sample_time"
#: relative deviations of what the logs' columns depend on. Torque constants are within 10 % in motor catalogues, two
#: deviations; magnets lose as much again when they are warm, and gears' efficiencies are up to 20 % below the
#: catalogue's at part load. A controller's own oscillator is off by up to 1 %, two deviations
DEVIATIONS = {_TORQUE: 0.1, _CLOCK: 0.005}
#: what can be wrong by one factor without another motion
_SCALED = ("ball.mass", "ball.inertia", "body.mass", "body.inertia.", "wheels.inertia", "drive.")
#: deviations of the difference beyond which a value contradicts the logs' own estimate
WRONG = 4.0


@dataclass(frozen=True, kw_only=True)
class FileValue:
    """A value of the robot file, and the logs' own estimate of it, SI units."""

    label: str
    value: float
    deviation: float
    own: float  #: by the logs
    own_error: float
    degrees: float  #: of freedom of that error

    @reported
    def apart(self) -> float:
        """How many deviations of their difference both are apart: of a normal variable as unlikely as Student's."""
        share = self.own_error**2 / (self.deviation**2 + self.own_error**2)
        ratio = (self.own - self.value) / float(np.hypot(self.deviation, self.own_error))
        # B. Welch (1947): the file's deviation is known
        tail = special.stdtr(self.degrees / max(share, 1e-9) ** 2, -abs(ratio))
        return math.copysign(float(-special.ndtri(tail)), ratio)


@dataclass(frozen=True, kw_only=True, eq=False)
class FileErrors:
    """What the errors of a robot file do to an estimate."""

    added: Floats  #: to its scaled covariance (p, p)
    rolling: Floats  #: likewise, by the error that a C_rr found beforehand has from the logs (p, p)
    #: deviation of the torque constant [N m/A], 0 if it is exact, and its covariance with the scaled estimate (p,)
    torque: tuple[float, Floats]
    values: tuple[FileValue, ...]


def from_file(experiment: Balancing, estimate: Fit[WindowsIterate], found: FoundRolling | None) -> FileErrors:
    """Return what the robot file's errors do to an estimate, and the file's values beside the logs'.

    `found` is a C_rr that the fit held.
    """
    coordinates, end, p = experiment.coordinates, estimate.finished.end, len(estimate.estimated)
    free = {coordinates.names[i] for i in np.flatnonzero(coordinates.free)}
    robot = with_file_errors(experiment.predictor.robot, free)
    numbers, R = uncertain(robot), correlations(robot)
    pairs = [] if found is None else [found.pair(experiment)]
    before = p + len(pairs)
    pairs += [_pair(experiment, robot, number) for number in numbers]
    joint = experiment.linearize_widely(end.point, end.windows.starts, others=pairs).equations
    kept = estimate.estimated & (joint.matrix.diagonal()[:p] > 0.0)
    scores = joint.scores[:, :p][:, kept]
    inverse = np.linalg.pinv(joint.matrix[:p, :p][np.ix_(kept, kept)], rcond=1e-13, hermitian=True)
    responses = np.zeros((p, len(pairs)))
    responses[kept] = -inverse @ joint.matrix[:p, p:][kept]
    response, by_rolling = responses[:, before - p :], np.zeros(p)
    if found is not None:
        by_rolling = responses[:, 0]
        by_rolling[found.index] = found.scaled_error
        response = response + np.outer(by_rolling, [found.moved_by(robot, number) for number in numbers])
    # without the correction for leverage, by which one window may have all
    blocks, estimated = scores.shape
    clustered = float(np.sum(scores @ inverse * scores)) / max(estimated, 1) * blocks / (blocks - estimated)
    clustered = max(estimate.discrepancy.factor**2 * clustered, 1.0)
    free_too, values = np.append(kept, np.ones(before - p, dtype=bool)), []
    for index, number in enumerate(numbers):
        size, value = number.deviation, value_of(robot, BY_NAME[number.name])
        stated = {"label": number.label, "value": float(numbers_of(value)[number.place]), "deviation": size}
        step, step_error, degrees = own_estimate(joint, free_too, index, clustered=clustered)
        own = {"own": stated["value"] + size * step, "own_error": size * step_error, "degrees": degrees}
        values.append(FileValue(**stated, **own))
    torque = np.array([number.deviation if number.name == _TORQUE else 0.0 for number in numbers])
    return FileErrors(
        added=response @ R @ response.T,
        rolling=np.outer(by_rolling, by_rolling),
        torque=(float(torque.sum()), response @ R @ torque),
        values=tuple(values),
    )


def with_file_errors(robot: Robot, estimated: Collection[str]) -> Robot:
    """Return a robot with deviations of those values that a prediction takes from its file."""
    lines = {line for name in estimated for line in QUANTITIES[name].lines}
    lines |= {_TORQUE} if "torque_gain" in estimated else set()
    scales = {_TORQUE: robot.drive.torque_constant, _CLOCK: robot.sensors.sample_time}
    known = dict(with_default_errors(robot).standard_deviations)
    known |= {name: DEVIATIONS[name] * value for name, value in scales.items()}
    known |= robot.standard_deviations
    kept = {name: size for name, size in known.items() if name not in lines and name[:9] != "friction."}
    return robot.annotated(standard_deviations=kept)


def _pair(experiment: Balancing, robot: Robot, number: Uncertain) -> tuple[Balancing, Balancing, float]:
    """Return the experiments with a value above and below the file's, and their distance in its deviations."""
    windows, predictor = experiment.windows, experiment.predictor

    def moved(by: float) -> Balancing:
        amount = by * number.deviation
        if number.name == _TORQUE:
            factor = 1.0 + amount / robot.drive.torque_constant
            scaled = replace(windows, torques=factor * windows.torques, earlier=factor * windows.earlier)
            return replace(experiment, windows=scaled)
        if number.name == _CLOCK:
            slower = windows.sample_time * (1.0 + amount / robot.sensors.sample_time)
            return replace(experiment, windows=replace(windows, sample_time=slower))
        return replace(
            experiment, predictor=replace(predictor, robot=shifted(predictor.robot, {number: amount}))
        )

    sides = []
    for by in (STEP, -STEP):
        try:
            sides.append((moved(by), by))
        except InputError:  # no body has that inertia
            sides.append((experiment, 0.0))
    (ahead, high), (behind, low) = sides
    return ahead, behind, (high - low) or 1.0


def own_estimate(
    joint: WindowEquations, kept: Bools, index: int, *, clustered: float
) -> tuple[float, float, float]:
    """Return the logs' own estimate of one value less the file's, its standard error, and that error's degrees.

    Both are in the file's deviations.
    """
    total, p = len(joint.matrix), len(kept)
    others = (np.arange(total) >= p) & (np.arange(total) != p + index)
    free = np.append(kept, np.ones(total - p, dtype=bool)) & (joint.matrix.diagonal() > 0.0)
    if not free[p + index]:
        return 0.0, np.inf, 1.0
    H, g = joint.matrix[np.ix_(free, free)], joint.scores.sum(axis=0)[free]
    prior, at = others[free], int(free[: p + index].sum())

    def fitted(weight: float) -> tuple[Floats, Floats]:
        inverse = np.linalg.pinv(H + weight * np.diag(prior), rcond=1e-13, hermitian=True)
        step = np.negative(inverse @ g, dtype=np.float64)
        return step, np.multiply(weight, inverse.diagonal(), dtype=np.float64)

    def excess(weight: float) -> float:
        step, variances = fitted(weight)
        return float((step[prior] ** 2 + variances[prior] - 1.0).sum())

    weight = clustered
    while excess(weight) > 0.0:  # by steps of 5 %, finer than any statistic here
        weight *= 1.05
    step, variances = fitted(weight)
    degrees = float((1.0 - fitted(clustered)[1][prior]).sum())
    return float(step[at]), float(np.sqrt(variances[at])), max(degrees, 1.0)


def file_value_findings(values: Collection[FileValue]) -> list[Finding]:
    """Return an error for each value that the logs refute, and a note on the scale that no log shows."""
    wrong = [
        error(
            "file-value",
            f"{value.label} is {digits(value.value)} +- {digits(value.deviation, 2)} in the robot file and "
            f"{digits(value.own)} +- {digits(value.own_error, 2)} by the logs, {abs(value.apart):.1f} deviations of "
            "this difference apart; measure it, state a larger standard_deviation, or go on with --accept file-value.",
        )
        for value in sorted(values, key=lambda value: -abs(value.apart))
        if abs(value.apart) > WRONG
    ]
    known = {
        value.label: value.value / value.deviation for value in values if value.label.startswith(_SCALED)
    }
    if not {"ball.mass", "body.mass", _TORQUE} <= known.keys():  # one of them is exact, or estimated
        return wrong
    text = (
        "Masses, inertias and torques that are all wrong by one factor give the same motion: no log shows it, and all "
        f"friction is wrong by it too. The robot file knows it to {100.0 / np.linalg.norm([*known.values()]):.2g} %."
    )
    return [*wrong, note("file-value", text)]

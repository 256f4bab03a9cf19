"""What the robot file does not know: its errors in the covariance of an estimate, and values that the logs refute.

Masses, lengths, inertias and the scales of torque and time come from the robot file, each with a standard deviation:
the file's, or that of its kind (`DEVIATIONS`, and `Parameter.error`). With the Gauss-Newton equations of the
parameters p and of these values v, in units of their deviations, the best p moves with the values, and with the
correlation R of their errors its covariance grows:

    dp/dv = -H_pp^-1 H_pv,          C + (dp/dv) R (dp/dv)^T

These are consider parameters (S. Schmidt, Application of state-space methods to navigation problems, Advances in
Control Systems 3 (1966) 293-340): they have priors, but keep the file's values, because what the model lacks would move
them. On two logs of the nominal twin, whose file is right, an inertia would move by 15 %, with a standard error of 4 %.

The logs' own estimate of a value is from a linear fit of the parameters and all values, with the priors of the others,
whose weights have the factor by which clustered variances exceed those of independent residuals.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from ballbot.arrays import Bools, Floats
from ballbot.errors import InputError
from ballbot.findings import Finding, error, note
from ballbot.fitting.fit import Fit
from ballbot.fitting.uncertainty import WindowEquations, covariance, leverage_corrected
from ballbot.identification.balancing import Balancing, WindowsIterate
from ballbot.identification.quantities import BY_NAME as QUANTITIES
from ballbot.results import reported
from ballbot.robot import Robot
from ballbot.robot.components import BY_NAME
from ballbot.robot.parameters import numbers_of, value_of
from ballbot.robot.variations import STEP, Uncertain, correlations, shifted, uncertain, with_default_errors
from ballbot.rounding import digits

_TORQUE, _CLOCK = "drive.torque_constant", "sensors.sample_time"
#: relative deviations of what the logs' columns depend on: torque constants, and gears' efficiencies, are within 10 %
#: in motor catalogues, here two deviations; a controller's own oscillator is off by up to 1 %, likewise
DEVIATIONS = {_TORQUE: 0.05, _CLOCK: 0.005}
#: what can be wrong by one factor without another motion
_SCALED = ("ball.mass", "ball.inertia", "body.mass", "body.inertia.", "wheels.inertia", "drive.")
#: factor on the clustered error of the logs' own estimate of a value, which what the model lacks moves farther: on logs
#: of 24 s of nine drawn robots whose files are right (`campaigns.drawn_robots`), 1.5 of them, root mean square, 5.7 at
#: most
_LACKS = 2.0
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

    @reported
    def apart(self) -> float:
        """How many deviations of their difference both are apart."""
        return (self.own - self.value) / float(np.hypot(self.deviation, self.own_error))


def from_file(experiment: Balancing, estimate: Fit[WindowsIterate]) -> tuple[Floats, tuple[FileValue, ...]]:
    """Return what the robot file's errors add to an estimate's scaled covariance (p, p), and the file's values."""
    coordinates, end, p = experiment.coordinates, estimate.finished.end, len(estimate.estimated)
    free = {coordinates.names[i] for i in np.flatnonzero(coordinates.free)}
    robot = _stated(experiment.predictor.robot, free)
    numbers, R = uncertain(robot), correlations(robot)
    pairs = [_pair(experiment, robot, number) for number in numbers]
    joint = experiment.linearize_widely(end.point, end.windows.starts, others=pairs).equations
    kept = estimate.estimated & (joint.matrix.diagonal()[:p] > 0.0)
    H, C = joint.matrix[:p, :p][np.ix_(kept, kept)], estimate.scaled_covariance[np.ix_(kept, kept)]
    response, weight = np.zeros((p, len(numbers))), max(float(np.trace(C @ H)) / max(len(H), 1), 1.0)
    response[kept] = -np.linalg.pinv(H, rcond=1e-13, hermitian=True) @ joint.matrix[:p, p:][kept]
    widen, values = _LACKS * estimate.discrepancy.factor, []
    for index, number in enumerate(numbers):
        step, step_error = _own_estimate(joint, kept, index, weight=weight, widen=widen)
        value = float(numbers_of(value_of(robot, BY_NAME[number.name]))[number.place])
        stated = {"label": number.label, "value": value, "deviation": number.deviation}
        values.append(
            FileValue(**stated, own=value + number.deviation * step, own_error=number.deviation * step_error)
        )
    return response @ R @ response.T, tuple(values)


def _stated(robot: Robot, estimated: Collection[str]) -> Robot:
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


def _own_estimate(
    joint: WindowEquations, kept: Bools, index: int, *, weight: float, widen: float
) -> tuple[float, float]:
    """Return the logs' own estimate of one value less the file's, and its standard error, in the file's deviations."""
    p, blocks, total = len(kept), len(joint.scores), joint.scores.shape[1]
    priors = np.sqrt(weight) * np.delete(np.eye(total)[p:], index, axis=0)  # a block each
    both = WindowEquations(
        np.concatenate([joint.matrices, priors[:, :, None] * priors[:, None, :]]),
        np.concatenate([joint.scores, 0.0 * priors]),
    )
    free = np.append(kept, both.matrix.diagonal()[p:] > 0.0)
    if not free[p + index]:
        return 0.0, np.inf
    inverse = np.linalg.pinv(both.matrix[np.ix_(free, free)], rcond=1e-13, hermitian=True)
    step = -float(inverse[free[: p + index].sum()] @ joint.scores.sum(axis=0)[free])
    scores = np.concatenate(
        [widen * leverage_corrected(both, free).scores[:blocks], np.sqrt(weight) * priors]
    )
    return step, float(np.sqrt(covariance(replace(both, scores=scores), free)[p + index, p + index]))


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

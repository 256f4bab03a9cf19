"""The ball's rolling friction, by the momentum about the floor's contact, which no torque inside the robot changes.

    d/dt (v + C w) = -Lambda (g + kappa v/|v|)            (`ballbot.mechanics.model.contact_momentum`)

Friction of the drivelines, losses of the rollers and play act between ball and body, and are not in it. A fit of
predicted states takes part of them for rolling friction: on six simulated robots C_rr was 29 to 137 % too large.

In the world frame, with s = v + C w and a bump phi of `DURATION`, integration by parts leaves nothing to differentiate:

    int phi Lambda g - int phi' C w = gamma int phi' v - gamma kappa int phi Lambda v/|v| + int phi Lambda e

e is the error of the lean, for each log one in the body's frame, of the AHRS or of a centre of mass beside the axis,
and one in the world's, of a floor's slope.
The complex gain gamma is that of a wheel radius off by its size and an IMU turned against the wheels by its angle:
without it, 2 degrees halved C_rr on one robot. Least squares over the bumps of all logs give kappa, with a standard
error clustered by `TOGETHER` bumps, and with it C_rr.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.fitting.intervals import Interval, Uncertainty
from ballbot.identification.balancing import Balancing
from ballbot.identification.quantities import Coordinates
from ballbot.log import Log
from ballbot.log.evidence import TINY
from ballbot.mechanics.model import contact_momentum
from ballbot.robot import Robot
from ballbot.robot.variations import STEP, Uncertain, shifted

#: of a bump [s]: longer than the swaying of a robot that balances
DURATION = 2.0
#: bumps whose errors depend on each other; each overlaps the next by half
TOGETHER = 8
#: ball speed below which friction has no certain direction, and counts in proportion [m/s]
_SLOW = 0.005
#: bumps that are needed: with one log, 16 numbers for 8 unknowns
_LEAST = 8
#: gamma's largest distance from one; logs of a tethered robot have 0.7, those of free ones up to 0.05
_FREE = 0.15
#: relative deviation of C_rr by rollers, play and delays: the root mean square error on 18 simulated robots is 5.4 %
_LACKING = 0.06

Complex = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True, eq=False)
class RollingMotion:
    """Integrals over k bumps of logs: in the world, complex, of a vector's two components in the heading frame."""

    log: NDArray[np.intp]  #: (k,) of each bump
    velocity: Complex  #: (k, 2) of phi' v
    lean_rate: Complex  #: (k, 2) of phi' w
    upward: Complex  #: (k, 2) of phi g
    against: Complex  #: (k, 2) of phi v/|v|
    #: (4, k, 2) of phi, a unit error of the lean: along both axes of the body, and of the world
    error: Complex

    @staticmethod
    def of(logs: Sequence[Log], robot: Robot) -> "RollingMotion | None":
        """Return the integrals over logs with one sample time.

        None if the bumps are too few, or more than gravity moves the ball (a tether, a hand, wheels that slip).
        """
        step = logs[0].sample_time
        count = round(DURATION / step)
        into = np.linspace(0.0, np.pi, count + 1)
        phi, change = step * np.sin(into) ** 2, np.pi / count * np.sin(2.0 * into)
        numbers, pieces = list[int](), list[Complex]()
        for number, log in enumerate(logs):
            rows = np.arange(0, max(len(log) - count, 0), max(count // 2, 1))[:, None] + np.arange(count + 1)
            out = np.exp(1j * log["psi"])
            v = (log["x_dot"] + 1j * log["y_dot"]) / out
            w = (log["theta_dot"] + 1j * log["phi_dot"]) / out
            g = (1j * np.sin(log["theta"]) - np.sin(log["phi"])) / out
            along, one = v / np.maximum(np.abs(v), _SLOW), np.ones_like(v)
            bumps = np.stack([v, w, g, along, one, 1j * one, one / out, 1j / out])
            even = np.abs(log.t[rows[:, -1]] - log.t[rows[:, 0]] - count * step) < 0.5 * step
            whole = rows[even & np.isfinite(bumps.sum(axis=0)[rows]).all(axis=1)]
            weights = np.stack([change, change, *[phi] * 6])[:, None]
            parts = [(weights * (part * out)[:, whole]).sum(axis=2) for part in (bumps.real, bumps.imag)]
            pieces.append(np.stack(parts, axis=-1))
            numbers += [number] * len(whole)
        velocity, lean_rate, upward, against, *error = np.concatenate(pieces, axis=1)
        if len(numbers) < _LEAST:
            return None
        motion = RollingMotion(
            log=np.array(numbers),
            velocity=velocity,
            lean_rate=lean_rate,
            upward=upward,
            against=against,
            error=np.stack(error),
        )
        re, im = motion.solved(robot)[0][:2]
        return motion if np.hypot(re - 1.0, im) < _FREE else None

    def solved(self, robot: Robot) -> tuple[Floats, Floats]:
        """Return, for a robot with these masses and lengths, gamma, gamma C_rr and e of each log, and their covariance.

        Each is a pair of real and imaginary part. A log weighs as the inverse of its mean square residual.
        """
        law = contact_momentum(robot.replace({"friction.rolling": 1.0}))

        def turned(matrix: Floats, of: Complex) -> Complex:
            """Return the integrals (.., k) of a matrix times a vector."""
            return of @ (matrix[0] + 1j * matrix[1])

        v, fallen = self.velocity @ np.array([1.0, 1j]), turned(law.pull, self.upward)
        fallen -= turned(law.lever[:, :2], self.lean_rate)
        against, errors = law.rolling * turned(law.pull, self.against), turned(law.pull, self.error)
        of_logs = self.log[:, None] == np.unique(self.log)
        columns = [v, 1j * v, -against, -1j * against, *(error[:, None] * of_logs for error in errors)]
        both: Complex = np.column_stack(columns)
        Z, y = np.stack([both.real, both.imag]), np.stack([fallen.real, fallen.imag])

        def fitted(weight: Floats) -> tuple[Floats, Floats, Floats]:
            """Return the parameters, the inverse of their normal matrix, and the residuals (2, k)."""
            inverse = np.linalg.pinv(np.einsum("rki,k,rkj->ij", Z, weight, Z), hermitian=True)
            found = inverse @ np.einsum("rki,k,rk->i", Z, weight, y)
            return found, inverse, y - Z @ found

        *_, residuals = fitted(np.ones(len(v)))
        weight = of_logs @ (of_logs.sum(axis=0) / np.maximum((residuals**2).sum(axis=0) @ of_logs, TINY))
        found, inverse, residuals = fitted(weight)
        scores = weight[:, None] * np.einsum("rki,rk->ki", Z, residuals)
        sums = np.add.reduceat(scores, np.arange(0, len(v), TOGETHER), axis=0)
        few = y.size / (y.size - len(found))
        return found, few * inverse @ sums.T @ sums @ inverse

    def rolling(self, robot: Robot) -> tuple[float, float]:
        """Return C_rr of a robot with these masses and lengths, and its standard error."""
        found, covariance = self.solved(robot)
        turn, size = found[:2] / np.hypot(*found[:2]), float(np.hypot(*found[2:4]))
        error = float(np.sqrt(turn @ covariance[2:4, 2:4] @ turn))
        return float(turn @ found[2:4]), float(np.hypot(error, _LACKING * size))


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundRolling:
    """C_rr by the momentum, which a fit of the other parameters holds."""

    motion: RollingMotion
    value: float
    error: float  #: from the logs
    coordinates: Coordinates  #: in which C_rr is free

    @staticmethod
    def of(logs: Sequence[Log], coordinates: Coordinates, robot: Robot) -> "FoundRolling | None":
        """Return C_rr by logs; None if it is not estimated, or the logs show nothing of it."""
        own = coordinates.parameters[coordinates.names.index("rolling")]
        motion = RollingMotion.of(logs, robot)
        if motion is None or own.bounds[0] == own.bounds[1]:
            return None
        value, error = motion.rolling(robot)
        if not error < 0.5 * (own.bounds[1] - own.bounds[0]):
            return None
        value = float(np.clip(value, *own.bounds))
        return FoundRolling(motion=motion, value=value, error=error, coordinates=coordinates)

    @property
    def index(self) -> int:
        """The index of C_rr among the parameters."""
        return self.coordinates.names.index("rolling")

    @property
    def scaled_error(self) -> float:
        """The error, scaled."""
        low, high = self.coordinates.parameters[self.index].bounds
        return self.error / (high - low)

    def held(self, *, by: float = 0.0) -> Coordinates:
        """Return the coordinates with C_rr held, so many errors away from its value."""
        parameters, value = [*self.coordinates.parameters], max(self.value + by * self.error, 0.0)
        parameters[self.index] = replace(parameters[self.index], default=value, bounds=(value, value))
        return replace(self.coordinates, parameters=tuple(parameters))

    def pair(self, experiment: Balancing) -> tuple[Balancing, Balancing, float]:
        """Return experiments with a C_rr above and below, and their distance in its errors."""
        ahead, behind = (self.held(by=by) for by in (STEP, -STEP))
        distance = float(ahead.nominal[self.index] - behind.nominal[self.index]) / self.error
        return replace(experiment, coordinates=ahead), replace(experiment, coordinates=behind), distance

    def moved_by(self, robot: Robot, number: Uncertain) -> float:
        """Return by how many of its errors C_rr is larger if the robot's number is larger by its deviation."""
        try:
            high, low = (
                self.motion.rolling(shifted(robot, {number: by * number.deviation}))[0]
                for by in (STEP, -STEP)
            )
        except InputError:  # no body has that inertia
            return 0.0
        return (high - low) / (2.0 * STEP * self.error)

    def opened(self, uncertainty: Uncertainty) -> Uncertainty:
        """Return the uncertainty of a fit that held C_rr, with C_rr as a parameter that has no error yet."""
        space, index = uncertainty.coordinates, self.index
        parameters, covariance = [*space.parameters], uncertainty.covariance.copy()
        parameters[index] = self.coordinates.parameters[index]
        covariance[index] = covariance[:, index] = 0.0
        space = replace(space, parameters=tuple(parameters))
        point = np.where(
            np.arange(len(parameters)) == index, space.scaled_one(index, self.value), uncertainty.point
        )
        own = {space.labels[index]: Interval(lower=self.value, upper=self.value, method="momentum")}
        return replace(
            uncertainty,
            coordinates=space,
            point=point,
            covariance=covariance,
            intervals={**uncertainty.intervals, **own},
        )

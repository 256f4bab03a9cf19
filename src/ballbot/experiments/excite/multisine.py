"""The family of references that a design chooses from: sines in x, y and psi, each within what the loop allows.

    r(t) = w(t) sum_k A_k (sin(2 pi f_k t + p_k) - sin p_k)        for each of x, y, psi;  w fades in and out

A slow sine moves the robot about the floor. A fast one hardly moves it and is a dither of the torques instead: K's
columns of x, y and psi turn the reference r into torques K r, so that for three wheels any dither d is the reference
K^-1 d. One reference file is therefore all that a controller needs, and the same on a robot as on the twin.

A sine of unit amplitude at f answers, in the linear closed loop x_dot = A x + B K (r - x), with

    G(f) = (2 pi i f I - A + B K)^-1 B K e        states         K (e - G(f))        torques

and the largest amplitude of that sine alone is what brings one of lean, place and torque to its limit. A member of the
family says in what shares of these the sines stand to one another. Phases are fixed and spread over the turn, which
halves what a search has to find.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.experiments.excite.limits import Limits
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot
from ballbot.simulation.run import sample_count

#: sines of each axis, from so many turns in the run (at least) to the fastest frequency [Hz]
SINES, LEAST_TURNS, SLOWEST, FASTEST = 5, 2.0, 0.08, 3.0
#: the axes' frequencies lie apart by this share, so that no two stay in step
_DETUNED = 0.07
#: the reference fades in and out over so long [s], a quarter of the run at most
_FADE = 2.0
#: no sine turns the reference's heading further than this [rad]
_MOST_TURN = 1.0

#: multiples of it, their whole part left out, spread evenly
_GOLDEN = 0.6180339887498949

_AXES = (0, 1, 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Family:
    """References that differ in the shares of their sines; a member is a point of the unit cube."""

    times: NDArray[np.float64]  #: (N,), the controller's samples [s]
    frequencies: NDArray[np.float64]  #: (3, k), of x, y and psi [Hz]
    largest: NDArray[np.float64]  #: (3, k), amplitudes of each sine alone [m, m, rad]

    @property
    def size(self) -> int:
        """Coordinates of a member: a share of each sine."""
        return self.frequencies.size

    def amplitudes(self, member: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return A (3, k) of a member (size,) [m, m, rad]."""
        shares = member**2  # squared, so that a search may all but leave sines out
        shares = shares / max(float(shares.sum()), 1e-12)
        return shares.reshape(self.frequencies.shape) * self.largest

    @property
    def phases(self) -> NDArray[np.float64]:
        """Phases p (3, k) [rad], spread evenly over the turn."""
        return (
            2.0
            * np.pi
            * np.modf(_GOLDEN * np.arange(self.frequencies.size))[0].reshape(self.frequencies.shape)
        )

    def poses(self, member: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return x, y and psi at every sample (N, 3) of a member (size,)."""
        amplitudes, phases = self.amplitudes(member), self.phases
        angles = 2.0 * np.pi * self.frequencies[..., None] * self.times + phases[..., None]
        waves = amplitudes[..., None] * (np.sin(angles) - np.sin(phases)[..., None])
        return (_fading(self.times) * waves.sum(axis=1)).T


def family(robot: Robot, controller: Controller, *, limits: Limits, duration: float) -> Family:
    """Return the references for a robot, its controller and a run's length.

    Parameters
    ----------
    robot : Robot
        Its friction is left out of the linear loop.
    controller : Controller
    limits : Limits
    duration : float
        [s]

    Raises
    ------
    InputError
        Where the duration is not at least a sample.
    """
    count = sample_count(duration, controller.sample_time)
    slowest = max(SLOWEST, LEAST_TURNS / duration)
    fastest = min(max(FASTEST, 2.0 * slowest), 0.2 / controller.sample_time)
    detuned = 1.0 + _DETUNED * np.arange(len(_AXES))
    frequencies = detuned[:, None] * np.geomspace(slowest, fastest, SINES)
    frictionless = Model(robot.replace(friction=Friction.none(robot.wheel_count)))
    return Family(
        times=controller.sample_time * np.arange(count, dtype=np.float64),
        frequencies=frequencies,
        largest=_largest(frictionless, controller, frequencies, limits),
    )


def _largest(
    model: Model, controller: Controller, frequencies: NDArray[np.float64], limits: Limits
) -> NDArray[np.float64]:
    """Return the amplitudes (3, k) at which each sine alone brings the linear loop to a limit."""
    linear, K = model.linearize(), controller.gain
    result = np.empty(frequencies.shape)
    for row, axis in enumerate(_AXES):
        unit = np.eye(10)[axis]
        for column, frequency in enumerate(frequencies[row]):
            loop = 2j * np.pi * frequency * np.eye(10) - linear.A + linear.B @ K
            G = np.abs(state := np.linalg.solve(loop, linear.B @ (K @ unit)))
            torque = np.abs(K @ (unit - state)).max()
            answers = (G[2:4].max() / limits.lean, G[:2].max() / limits.floor, torque / limits.torque)
            largest = 1.0 / max(*answers, 1e-9)
            result[row, column] = min(largest, _MOST_TURN) if axis == 4 else largest
    return result


def _fading(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return w (N,): from 0 to 1 and back to 0 in halves of a cosine."""
    end = float(times[-1])
    fade = max(min(_FADE, 0.25 * end), 1e-9)
    share = np.clip(np.minimum(times, end - times) / fade, 0.0, 1.0)
    return 0.5 - 0.5 * np.cos(np.pi * share)

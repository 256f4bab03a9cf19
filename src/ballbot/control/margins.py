"""Stability margins of a robot's loop: gain, phase and delay at each wheel and at all together, and the disk margin.

The loop is broken at the wheels' torques, where motors, gears and the processor's time act. A margin is how much a
torque may change on its way before the closed loop is unstable:

    gain    a factor k, up and down               the robot is unstable by itself, so that too little is fatal as well
    phase   a factor exp(-j phi)
    delay   more time until the torque acts, any fraction of a sample

at one wheel while the others stay as they are, and at all wheels alike. Each is found as the first point along its path
at which a pole of the sampled closed loop leaves the unit circle; nothing is read off a frequency grid.

The disk margin (Seiler, Packard & Gahinet, "An introduction to disk margins", IEEE Control Systems Magazine 40 (5),
2020; balanced, sigma = 0) covers changes of gain and phase at once: with every factor

    f_i = (1 + alpha delta_i / 2) / (1 - alpha delta_i / 2),      |delta_i| < 1 complex, one for each wheel

of the torques the loop stays stable while alpha < alpha_max, the reciprocal of the largest mu of (S - T)/2 over the
frequencies. At one wheel mu is an absolute value. At all wheels at once it is the least, over diagonal D > 0, of the
largest singular values of D M D^-1: exact for three wheels and an upper bound of mu for four, so that the margin stated
is never too large.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar, root_scalar

from ballbot.control.controller import Controller
from ballbot.control.linear import Matrix, RobotLoop, robot_loop
from ballbot.control.lqr import sampling_words
from ballbot.control.source import ControllerLike, as_controller
from ballbot.errors import InputError
from ballbot.results import reported
from ballbot.robot import RobotLike
from ballbot.summary import Summary, plotted, summarized

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: factors of the torques along which stability is looked at; beyond them a margin counts as unlimited
_GAINS = np.geomspace(1.0, 1e3, 150)
#: phases [rad]
_PHASES = np.linspace(0.0, math.pi, 121)
#: delay that is looked at [s]; beyond it a margin counts as unlimited
_LONGEST_DELAY = 1.0
#: by which rounding may move a pole out of the unit circle
_ROUNDING = 1e-7
#: relative precision of margins
_PRECISION = 1e-9
#: frequencies of the grid on which the largest mu and windings are looked for, before it is refined
_FREQUENCIES = 500
#: lowest frequency of it [rad/s]: below, the loop is an integrator chain
_LOWEST = 1e-3
#: lowest at which a balancing robot's sensitivity can be large [rad/s]
_LOWEST_SENSITIVE = 1e-1


@dataclass(frozen=True, kw_only=True)
class DiskMargin:
    """How much gain and phase may change together."""

    alpha: float  #: alpha_max, from 0 to 2
    frequency: float  #: at which the loop would oscillate [rad/s]

    @reported
    def gain(self) -> tuple[float, float]:
        """The least and the greatest factor that is allowed, without a change of phase."""
        half = 0.5 * self.alpha
        return (1.0 - half) / (1.0 + half), (1.0 + half) / (1.0 - half) if half < 1.0 else math.inf

    @reported
    def phase(self) -> float:
        """The change of phase that is allowed, without a change of gain [rad]."""
        return 2.0 * math.atan(0.5 * self.alpha)


@dataclass(frozen=True, kw_only=True)
class LoopMargins:
    """Margins of the loop broken at one wheel's torque, or at all alike."""

    gain_down: float  #: the factor at which too little torque destabilises; 0 if none does
    gain_up: float  #: the factor at which too much torque destabilises; infinite if none does
    phase: float  #: [rad]; infinite if no phase destabilises
    phase_frequency: float  #: at which the loop would oscillate then [rad/s]; NaN without one
    delay: float  #: [s], beyond the loop's own; infinite if none up to a second destabilises
    disk: DiskMargin


@summarized
@dataclass(frozen=True, kw_only=True, eq=False)
class Margins:
    """The margins of a robot's loop."""

    loop: RobotLoop
    wheels: tuple[LoopMargins, ...]  #: each broken by itself, the others closed
    together: LoopMargins  #: all alike; its disk is of all wheels at once, each with a change of its own

    def rows(self) -> list[tuple[str, ...]]:
        """Return the margins as rows of `HEADINGS`; wheels of the same margins, as by symmetry, in one row."""
        found = [_cells(one) for one in self.wheels]
        named = (
            [("each wheel", *found[0])]
            if len(set(found)) == 1
            else [(name, *cells) for name, cells in zip(self.loop.wheels, found, strict=True)]
        )
        return [*named, ("all wheels", *_cells(self.together))]

    def sentence(self) -> str:
        """Return the margins of all wheels' torques as a clause."""
        _, gain, phase, delay, *_ = self.rows()[-1]
        return f"all torques may be scaled by {gain}, shifted by {phase}, or delayed by {delay}"

    def summary(self) -> Summary:
        """Return the margins at each wheel and at all of them."""
        rows = [
            (f"{name}: {heading}", cell)
            for name, *cells in self.rows()
            for heading, cell in zip(HEADINGS[1:], cells, strict=True)
        ]
        return Summary(
            title=f"Margins of a loop {sampling_words(self.loop.sample_time)}",
            rows=tuple(rows),
            sentences=(MEANING,),
        )

    def plot(self) -> Figure:
        """Return a figure of the Bode diagram."""
        return plotted(self)

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "broken_at": "the wheels' torques",
            "model": "exact, without friction; the measured state is fed back",
            "loop_delay": self.loop.delay,
            "wheels": dict(zip(self.loop.wheels, self.wheels, strict=True)),
            "together": self.together,
        }


#: of the rows of margins
HEADINGS = ("torque of", "gain", "phase", "delay", "disk gain", "disk phase")
#: what the rows are
MEANING = (
    "The loop stays stable if a torque is scaled by a factor in this range, shifted by less than this phase or delayed "
    "by less than this time. Within the disk margins, gain and phase may change together, independently for each "
    "wheel. Friction and the lags of the estimator and of the motors are not included."
)


def _cells(one: LoopMargins) -> tuple[str, ...]:
    phase = f"{math.degrees(one.phase):.1f} deg at {one.phase_frequency:.3g} rad/s"
    return (
        _range(one.gain_down, one.gain_up),
        phase if math.isfinite(one.phase) else "any",
        f"{1e3 * one.delay:.3g} ms" if math.isfinite(one.delay) else f"over {1e3 * _LONGEST_DELAY:.0f} ms",
        _range(*one.disk.gain),
        f"{math.degrees(one.disk.phase):.1f} deg at {one.disk.frequency:.3g} rad/s",
    )


def _range(least: float, greatest: float) -> str:
    return f"{least:.2f} to {greatest:.3g}" if math.isfinite(greatest) else f"{least:.2f} or more"


def loop_margins(loop: RobotLoop | ControllerLike, *, robot: RobotLike | None = None) -> Margins:
    """Return the margins of a robot's loop.

    Parameters
    ----------
    loop : RobotLoop, Controller, "nominal", "precise" or controller file
        See `ballbot.control.linear` for what of a controller counts.
    robot : Robot, preset or robot file, optional
        Of a controller that is given by name or as a file.

    Raises
    ------
    InputError
        If the loop is unstable as it is, or it is not a loop or a controller of Ballbot.
    """
    if isinstance(loop, str | Path) and robot is not None:
        loop = as_controller(loop, robot)
    if isinstance(loop, Controller):
        loop = robot_loop(loop)
    if not isinstance(loop, RobotLoop):
        given = repr(loop) if isinstance(loop, str) else f"an object of type {type(loop).__name__}"
        raise InputError(
            f"The margins of {given} are not known; give a Controller, which knows its robot, or the name of a "
            "ready-made one with the robot, as in loop_margins('nominal', robot='alten')."
        )
    radius = _radius(loop.closed())
    if not radius < 1.0:
        raise InputError(
            f"The loop of this controller is unstable (a mode grows by {radius:.6g} in each sample): leave out or "
            "change a part that turns its phase, such as a notch at a low frequency, or shorten the sample time."
        )
    count = len(loop.wheels)
    omega = _frequencies(loop)
    response = loop.response(omega)
    wheels = tuple(_margins_of(loop, direction, omega, response) for direction in np.eye(count))
    return Margins(loop=loop, wheels=wheels, together=_margins_of(loop, np.ones(count), omega, response))


def sensitivity_peak(
    loop: RobotLoop, passed: Callable[[Matrix], NDArray[np.complex128]] = np.ones_like
) -> float:
    """Return the largest 1/|1 + L| of all wheels alike over the frequencies; infinite if that loop is unstable.

    Below 2, all torques may double, fall to two thirds, or turn by 29 deg. The loop is stable by itself; `passed` is
    what else the torques pass on their way, from omega (f,) [rad/s] to (f,).
    """
    omega = np.geomspace(_LOWEST_SENSITIVE, math.pi / loop.sample_time, _FREQUENCIES)
    loci = np.linalg.eigvals(loop.response(omega))
    late = 1.0 + loci * np.asarray(passed(omega))[:, None]
    ratio = np.prod(late, axis=1) / np.prod(1.0 + loci, axis=1)
    # a stable loop's det(I + L) winds round zero as often as without: each pole outside turns it by pi
    if abs(np.angle(ratio[1:] / ratio[:-1]).sum()) > 0.5 * math.pi:
        return math.inf
    return float(1.0 / np.abs(late).min())


def _margins_of(
    loop: RobotLoop, direction: Matrix, omega: Matrix, response: NDArray[np.complex128]
) -> LoopMargins:
    """Return the margins if the torques marked in `direction` (n,), ones and zeros, change alike."""
    # the closed loop is rest + factor * marked: only the marked torques change
    A, B, C = loop.broken()
    marked = (B * direction) @ C
    rest = A + B @ C - marked

    def late(delay: float) -> Matrix:
        A, B, C = loop.broken(delay * direction)
        return A + B @ C

    # the negative phases are the conjugate poles'
    phase = _first_loss(lambda phi: rest + np.exp(-1j * phi) * marked, _PHASES)
    frequency, delay = math.nan, math.inf
    if math.isfinite(phase):
        poles = np.linalg.eigvals(rest + np.exp(-1j * phase) * marked)
        frequency = float(abs(np.angle(poles[np.argmax(np.abs(poles))])) / loop.sample_time)
        # exact between the samples; no longer than what turns the phase by the phase margin at its frequency
        longest = min(2.0 * phase / max(frequency, 1e-9), _LONGEST_DELAY)
        samples = np.arange(math.floor(longest / loop.sample_time) + 2, dtype=np.float64)
        delay = _first_loss(late, loop.sample_time * samples)
    return LoopMargins(
        gain_down=1.0 / _first_loss(lambda inverse: rest + (1.0 / inverse) * marked, _GAINS),
        gain_up=_first_loss(lambda factor: rest + factor * marked, _GAINS),
        phase=phase,
        phase_frequency=frequency,
        delay=delay,
        disk=_disk_margin(loop, np.flatnonzero(direction), omega, response),
    )


def _radius(matrix: NDArray[np.complex128] | Matrix) -> float:
    """Return the largest absolute value of a matrix's poles."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def _first_loss(closed: Callable[[float], NDArray[np.complex128] | Matrix], path: Matrix) -> float:
    """Return the first point of a path, from its stable begin, at which a loop loses stability; else infinity."""
    stable = 0.0
    for point in path.tolist():
        if _radius(closed(point)) > 1.0 + _ROUNDING:
            if _radius(closed(stable)) >= 1.0:  # by rounding
                return stable
            found = root_scalar(
                lambda at: _radius(closed(at)) - 1.0, bracket=(stable, point), xtol=_PRECISION * point
            )
            return float(found.root)
        stable = point
    return math.inf


def _frequencies(loop: RobotLoop) -> Matrix:
    """Return frequencies [rad/s] up to the Nyquist frequency, close together about the poles of the closed loop."""
    nyquist = math.pi / loop.sample_time
    poles = np.linalg.eigvals(loop.closed())
    poles = poles[np.abs(poles) > 1e-6]
    sizes = np.abs(np.log(poles.astype(complex))) / loop.sample_time
    near = (sizes[:, None] * np.linspace(0.5, 2.0, 31)).ravel()
    grid = np.concatenate(
        [np.geomspace(_LOWEST, nyquist, _FREQUENCIES), np.linspace(_LOWEST, nyquist, _FREQUENCIES), near]
    )
    return np.unique(grid[(grid >= _LOWEST) & (grid <= nyquist)])


def _disk_margin(
    loop: RobotLoop, wheels: NDArray[np.int64], omega: Matrix, response: NDArray[np.complex128]
) -> DiskMargin:
    """Return the disk margin of factors of some wheels' torques, each its own."""
    scales = np.zeros(len(wheels) - 1)

    def halves(of: NDArray[np.complex128]) -> NDArray[np.complex128]:
        eye = np.eye(of.shape[-1])
        both = np.linalg.solve(eye + of, eye - of)  # S - T
        return np.asarray(0.5 * both[:, wheels[:, None], wheels], dtype=np.complex128)

    def mu(one: NDArray[np.complex128]) -> float:
        if len(wheels) == 1:
            return float(abs(one[0, 0]))
        return float(minimize(_scaled_norm, scales, args=(one,), method="Nelder-Mead", options=_SEARCH).fun)

    matrices = halves(response)
    bounds = np.linalg.norm(matrices, 2, axis=(1, 2))  # without scales: never below mu
    best, place = 0.0, 0
    for index in np.argsort(-bounds):
        if bounds[index] <= best:
            break
        found = mu(matrices[index])
        if found > best:
            best, place = found, int(index)
    around = omega[max(place - 1, 0)], omega[min(place + 1, len(omega) - 1)]
    near = minimize_scalar(
        lambda at: -mu(halves(loop.response(np.array([at])))[0]), bounds=around, method="bounded"
    )
    frequency = float(near.x) if -near.fun > best else float(omega[place])
    return DiskMargin(alpha=float(min(2.0, 1.0 / max(best, -near.fun))), frequency=frequency)


#: of the scales D
_SEARCH = {"xatol": 1e-6, "fatol": 1e-10}


def _scaled_norm(logarithms: Matrix, matrix: NDArray[np.complex128]) -> float:
    """Return the largest singular value of D M D^-1 for D = diag(exp(logarithms), 1)."""
    scale = np.exp(np.append(logarithms, 0.0))
    return float(np.linalg.norm(matrix * (scale[:, None] / scale), 2))

"""Stability margins of a robot's loop: gain, phase and delay at each wheel and at all together, and the disk margin.

The loop is opened at the wheels' torques, where motors, gears and computing time act. A margin is how much a torque may
change on its way to the wheel before the closed loop becomes unstable:

    gain    a factor k, up and down               the robot is unstable by itself, so too low a gain is unstable too
    phase   a factor exp(-j phi)
    delay   additional dead time, any fraction of a sample

at one wheel while the others stay unchanged, and equally at all wheels. Each is the first point along its path at which
a pole of the sampled closed loop leaves the unit circle, so that it does not depend on a frequency grid.

The disk margin (Seiler, Packard & Gahinet, "An introduction to disk margins", IEEE Control Systems Magazine 40 (5),
2020; balanced, sigma = 0) covers changes of gain and phase at once: with every factor

    f_i = (1 + alpha delta_i / 2) / (1 - alpha delta_i / 2),      |delta_i| < 1 complex, one for each wheel

of the torques the loop stays stable while alpha < alpha_max = 1 / max over frequency of mu((S - T)/2). At one wheel mu
is an absolute value. At all wheels it is taken as the minimum over diagonal D > 0 of the largest singular value of
D M D^-1. This bound is exact for three wheels (J. Doyle, IEE Proceedings D 129 (1982) 242-250: up to three complex
blocks) and an upper bound for four, so that the stated margin is never too large.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

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
from ballbot.summary import Plotted, Summary

#: factors of the torques at which stability is tested; beyond them a margin counts as unlimited
_GAINS = np.geomspace(1.0, 1e3, 150)
#: phases [rad]
_PHASES = np.linspace(0.0, math.pi, 121)
#: longest delay that is tested [s]; beyond it a margin counts as unlimited
_LONGEST_DELAY = 1.0
#: distance by which rounding may move a pole out of the unit circle
_ROUNDING = 1e-7
#: relative precision of margins
_PRECISION = 1e-9
#: frequencies of the grid on which mu and windings are evaluated before the peak is refined
_FREQUENCIES = 500
#: lowest frequency of the grid [rad/s]: below it the loop is a chain of integrators
_LOWEST = 1e-3


@dataclass(frozen=True, kw_only=True)
class DiskMargin:
    """The simultaneous change of gain and phase that is allowed."""

    alpha: float  #: alpha_max, from 0 to 2
    frequency: float  #: of the oscillation at the margin [rad/s]

    @reported
    def gain(self) -> tuple[float, float]:
        """The smallest and the largest factor that is allowed, without a change of phase."""
        half = 0.5 * self.alpha
        return (1.0 - half) / (1.0 + half), (1.0 + half) / (1.0 - half) if half < 1.0 else math.inf

    @reported
    def phase(self) -> float:
        """The change of phase that is allowed, without a change of gain [rad]."""
        return 2.0 * math.atan(0.5 * self.alpha)


@dataclass(frozen=True, kw_only=True)
class LoopMargins:
    """Margins of the loop opened at one wheel's torque, or equally at all."""

    gain_down: float  #: the factor at which too little torque destabilises; 0 if none does
    gain_up: float  #: the factor at which too much torque destabilises; infinite if none does
    phase: float  #: [rad]; infinite if no phase destabilises
    phase_frequency: float  #: of the oscillation at the phase margin [rad/s]; NaN without a phase margin
    delay: float  #: [s], beyond the loop's own; infinite if no delay up to a second destabilises
    disk: DiskMargin


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Margins(Plotted):
    """The margins of a robot's loop; `plot()` shows its Bode diagram."""

    loop: RobotLoop
    wheels: tuple[LoopMargins, ...]  #: each opened by itself, the others closed
    together: LoopMargins  #: equal changes at all wheels; the disk margin allows a different change at each

    def rows(self) -> list[tuple[str, ...]]:
        """Return the margins as rows of `HEADINGS`; wheels of the same margins, as by symmetry, in one row."""
        rows = [_cells(margins) for margins in self.wheels]
        named = (
            [("each wheel", *rows[0])]
            if len(set(rows)) == 1
            else [(name, *cells) for name, cells in zip(self.loop.wheels, rows, strict=True)]
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

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "broken_at": "the wheels' torques",
            "model": "exact, without friction; the measured state is fed back",
            "loop_delay": self.loop.delay,
            "wheels": dict(zip(self.loop.wheels, self.wheels, strict=True)),
            "together": self.together,
        }


#: headings of the rows of margins
HEADINGS = ("torque of", "gain", "phase", "delay", "disk gain", "disk phase")
#: explanation of the rows
MEANING = (
    "The loop stays stable if a torque is scaled by a factor in this range, shifted by less than this phase or delayed "
    "by less than this time. Within the disk margins, gain and phase may change together, independently for each "
    "wheel. Friction and the lags of the estimator and of the motors are not included."
)


def _cells(margins: LoopMargins) -> tuple[str, ...]:
    phase = f"{math.degrees(margins.phase):.1f} deg at {margins.phase_frequency:.3g} rad/s"
    return (
        _range(margins.gain_down, margins.gain_up),
        phase if math.isfinite(margins.phase) else "any",
        f"{1e3 * margins.delay:.3g} ms"
        if math.isfinite(margins.delay)
        else f"over {1e3 * _LONGEST_DELAY:.0f} ms",
        _range(*margins.disk.gain),
        f"{math.degrees(margins.disk.phase):.1f} deg at {margins.disk.frequency:.3g} rad/s",
    )


def _range(least: float, greatest: float) -> str:
    return f"{least:.2f} to {greatest:.3g}" if math.isfinite(greatest) else f"{least:.2f} or more"


def loop_margins(loop: RobotLoop | ControllerLike, *, robot: RobotLike | None = None) -> Margins:
    """Return the margins of a robot's loop.

    Parameters
    ----------
    loop : RobotLoop, Controller, "nominal", "precise" or controller file
        `ballbot.control.linear` lists the parts of a controller that are included.
    robot : Robot, preset or robot file, optional
        The robot of a controller that is given by name or as a file.

    Returns
    -------
    Margins

    Raises
    ------
    InputError
        If the loop is unstable, or the argument is neither a loop nor a controller of Ballbot.

    Examples
    --------
    >>> margins = loop_margins("nominal", robot="alten")
    >>> margins.sentence()
    'all torques may be scaled by 0.48 to 34, shifted by 59.2 deg at 10.5 rad/s, or delayed by 98.2 ms'
    >>> round(margins.together.disk.alpha, 2)
    0.7
    """
    if isinstance(loop, str | Path) and robot is not None:
        loop = as_controller(loop, robot)
    if isinstance(loop, Controller):
        loop = robot_loop(loop)
    if not isinstance(loop, RobotLoop):
        given = repr(loop) if isinstance(loop, str) else f"an object of type {type(loop).__name__}"
        raise InputError(
            f"The margins of {given} cannot be computed; give a Controller, which knows its robot, or the name of a "
            "ready-made one with the robot, as in loop_margins('nominal', robot='alten')."
        )
    radius = _radius(loop.closed())
    if not radius < 1.0:
        grows = f"grows by {100.0 * (radius - 1.0):.2g} % in each sample"
        raise InputError(
            "The loop of this controller is unstable: an error "
            f"{grows if radius > 1.0 + _ROUNDING else 'neither grows nor decays'}."
        )
    count = len(loop.wheels)
    omega = _frequencies(loop)
    response = loop.response(omega)
    wheels = tuple(_margins_of(loop, direction, omega, response) for direction in np.eye(count))
    return Margins(loop=loop, wheels=wheels, together=_margins_of(loop, np.ones(count), omega, response))


def _margins_of(
    loop: RobotLoop, direction: Matrix, omega: Matrix, response: NDArray[np.complex128]
) -> LoopMargins:
    """Return the margins for an equal change of the torques marked by ones in `direction` (n,)."""
    # the closed loop is rest + factor * marked: only the marked torques change
    A, B, C = loop.broken()
    marked = (B * direction) @ C
    rest = A + B @ C - marked

    def late(delay: float) -> Matrix:
        A, B, C = loop.broken(delay * direction)
        return A + B @ C

    # negative phases give the conjugate poles
    phase = _first_loss(lambda phi: rest + np.exp(-1j * phi) * marked, _PHASES)
    frequency, delay = math.nan, math.inf
    if math.isfinite(phase):
        poles = np.linalg.eigvals(rest + np.exp(-1j * phase) * marked)
        frequency = float(abs(np.angle(poles[np.argmax(np.abs(poles))])) / loop.sample_time)
        # exact between the samples; twice the delay that turns the phase by the phase margin at its frequency suffices
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
    """Return the spectral radius of a matrix."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def _first_loss(closed: Callable[[float], NDArray[np.complex128] | Matrix], path: Matrix) -> float:
    """Return the first point of a path, which starts stable, at which a loop loses stability; else infinity."""
    stable = 0.0
    for point in path.tolist():
        if _radius(closed(point)) > 1.0 + _ROUNDING:
            if _radius(closed(stable)) >= 1.0:  # by rounding
                return stable
            crossing = root_scalar(
                lambda at: _radius(closed(at)) - 1.0, bracket=(stable, point), xtol=_PRECISION * point
            )
            return float(crossing.root)
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
    """Return the disk margin for independent factors of some wheels' torques."""
    scales = np.zeros(len(wheels) - 1)

    def halves(of: NDArray[np.complex128]) -> NDArray[np.complex128]:
        eye = np.eye(of.shape[-1])
        both = np.linalg.solve(eye + of, eye - of)  # S - T
        return np.asarray(0.5 * both[:, wheels[:, None], wheels], dtype=np.complex128)

    def mu(matrix: NDArray[np.complex128]) -> float:
        if len(wheels) == 1:
            return float(abs(matrix[0, 0]))
        return float(
            minimize(_scaled_norm, scales, args=(matrix,), method="Nelder-Mead", options=_SEARCH).fun
        )

    matrices = halves(response)
    bounds = np.linalg.norm(matrices, 2, axis=(1, 2))  # D = I: an upper bound of mu
    best, peak = 0.0, 0
    for index in np.argsort(-bounds):
        if bounds[index] <= best:
            break
        value = mu(matrices[index])
        if value > best:
            best, peak = value, int(index)
    around = omega[max(peak - 1, 0)], omega[min(peak + 1, len(omega) - 1)]
    near = minimize_scalar(
        lambda at: -mu(halves(loop.response(np.array([at])))[0]), bounds=around, method="bounded"
    )
    frequency = float(near.x) if -near.fun > best else float(omega[peak])
    return DiskMargin(alpha=float(min(2.0, 1.0 / max(best, -near.fun))), frequency=frequency)


#: tolerances of the search for the scales D
_SEARCH = {"xatol": 1e-6, "fatol": 1e-10}


def _scaled_norm(logarithms: Matrix, matrix: NDArray[np.complex128]) -> float:
    """Return the largest singular value of D M D^-1 for D = diag(exp(logarithms), 1)."""
    scale = np.exp(np.append(logarithms, 0.0))
    return float(np.linalg.norm(matrix * (scale[:, None] / scale), 2))

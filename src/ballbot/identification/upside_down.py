"""Friction of drivelines and ball-wheel contacts from a robot clamped upside down, the ball on its wheels (thesis 3.2).

Contact forces act on both wheels and ball, so whatever slips between them, the momentum of ball and drivelines changes
by the torques of the motors and the friction only:

    d/dt (J Omega + (j_w + j_r) A^T w) = A^T (u - tau(w)) - B Omega
    tau = b w + (c + s exp(-|w/v_s|^delta)) sgn(w)

w is measured by the encoders, or A Omega in a log without them. B is a loss where rollers touch the ball, as of two
that touch it at once. A robot file has no such friction, and without it b would be too large. Residuals are those of
the integrated equation over pieces of 0.05 s, in blocks of a window. The sign of a slow wheel's speed is uncertain, and
its friction is not a function of speed; the directions in which it acts are then left out. So are rows at the limit of
speed or torque, where the logged torque does not act. delta is 1 unless held-out windows support another; the errors
then include those of other deltas.

Held-out windows validate the friction: the ball is simulated with and without it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.findings import Finding, note, warning
from ballbot.fitting.experiment import Dependence, Residuals, residuals_without_states
from ballbot.fitting.fit import fit, released
from ballbot.fitting.parameter import FitParameter
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.uncertainty import discrepancy
from ballbot.identification.axis.identify import DELTA_DEVIATION, DELTA_HELD
from ballbot.identification.driveline import BALL_NAMES, robot_with_friction
from ballbot.identification.excitation import WINDOWS_PER_PARAMETER
from ballbot.identification.quantities import Bounds, scale_between
from ballbot.identification.result import ParameterTable, Verdict, verdict_of
from ballbot.identification.stated_uncertainty import StageEstimate, file_findings
from ballbot.identification.windows import LARGEST_JITTER, Span, Windows, common_sample_time
from ballbot.log import Log, LogsLike, as_logs
from ballbot.log.checks.values import spiked_rows
from ballbot.log.columns import torque_names, wheel_angle_names, wheel_speed_names
from ballbot.mechanics.friction import stribeck_curve
from ballbot.progress import Progress
from ballbot.robot import Friction, Robot, RobotLike, as_robot
from ballbot.rounding import plus_minus
from ballbot.simulation.upside_down import ClampedBall, simulate_balls
from ballbot.summary import Reported

#: the initial state of a window is the mean over so many samples on either side of its first
NEIGHBOURS = 4
#: momentum and torques of a row are the means over so many samples on either side
SMOOTHED = 2
#: length of the pieces that the residuals are integrals over [s]
PIECE = 0.05
#: least speed of a wheel that counts [rad/s]; below, an encoder's wheel and the ball are apart while play is crossed
SLOW = 0.2
#: above this share of the supply's speed limit, the logged torque does not act
AT_LIMIT = 0.95
#: v_s is between these speeds [rad/s]
SHAPES = (0.05, 5.0)
_SHAPE = ("stribeck_speed", "stribeck_exponent")
#: Student's quantile for 95 % with the least number of windows
QUANTILE = 2.1


class _BallLog:
    """The rows of a log of the ball on the clamped robot."""

    def __init__(self, robot: Robot, log: Log) -> None:
        names = torque_names(robot.wheel_count)
        self.torques = np.column_stack([log[name] for name in names])  # u (N, n) [N m]
        self.omega = np.column_stack([log[name] for name in BALL_NAMES])  # the ball's (N, 3) [rad/s]
        speeds, A = encoder_speeds(log, robot.wheel_count), ClampedBall.of_robot(robot).A
        self.wheel_speeds = np.column_stack(speeds) if speeds else self.omega @ A.T  # (N, n) [rad/s]
        drive = robot.drive
        fastest = AT_LIMIT * drive.top_speed
        # rows (N,) in which a motor cannot give the logged torque
        beyond = (np.abs(self.wheel_speeds) > fastest) | (np.abs(self.torques) > drive.torque_limit)
        # rows (N,) that are complete, evenly spaced, without spike and not at a limit
        valid = np.isfinite(np.hstack([self.torques, self.omega])).all(axis=1) & ~beyond.any(axis=1)
        self.valid = np.asarray(valid, dtype=np.bool_)
        self.valid &= ~spiked_rows(log, (*names, *BALL_NAMES))
        self.valid[:-1] &= np.abs(np.diff(log.t) - log.sample_time) <= LARGEST_JITTER * log.sample_time

    def tiles(self, samples: int) -> range:
        """Return the first rows of windows that lie end to end."""
        return range(NEIGHBOURS, len(self.omega) - samples - NEIGHBOURS, samples)


def encoder_speeds(log: Log, count: int) -> list[Floats]:
    """Return the logged wheel speeds, or the slopes of wheel angles over 50 ms; an empty list without both."""
    names, angles = wheel_speed_names(count), wheel_angle_names(count)
    if all(name in log for name in names):
        return [log[name] for name in names]
    half = max(1, round(0.025 / log.sample_time))
    if not all(name in log for name in angles) or len(log) <= 2 * half:
        return []
    missing = np.full(half, np.nan)
    lasted = log.t[2 * half :] - log.t[: -2 * half]
    slopes = [(log[name][2 * half :] - log[name][: -2 * half]) / lasted for name in angles]
    return [np.concatenate([missing, slope, missing]) for slope in slopes]


def predicted_velocity(windows: Windows, ball: ClampedBall, friction: Friction) -> Floats:
    """Return the ball's predicted Omega (w, m, 3) [rad/s] with a friction."""
    return simulate_balls(
        ball,
        friction=friction,
        initial=windows.initial,
        torques=windows.torques,
        sample_time=windows.sample_time,
    )


def cut_ball_windows(robot: Robot, logs: Sequence[Log], *, duration: float) -> Windows:
    """Cut logs into complete windows of Omega [rad/s] without rows at a limit; InputError if there are none."""
    sample_time = common_sample_time(logs, duration=duration)
    samples = round(duration / sample_time)
    initial, torques, measured, spans = [], [], [], []
    for number, log in enumerate(logs):
        ball = _BallLog(robot, log)
        for k in ball.tiles(samples):
            if ball.valid[k - NEIGHBOURS : k + samples + 1].all():
                initial.append(ball.omega[k - NEIGHBOURS : k + NEIGHBOURS + 1].mean(axis=0))
                torques.append(ball.torques[k : k + samples])
                measured.append(ball.omega[k + 1 : k + samples + 1])
                spans.append(Span(log=number, start=float(log.t[k]), end=float(log.t[k + samples])))
    if not spans:
        raise InputError(
            f"No log has {duration:g} s without a gap, a missing value or a row at the limit of speed or torque; "
            "choose a shorter window."
        )
    return Windows(
        initial=np.array(initial),
        torques=np.array(torques),
        measured=np.array(measured),
        earlier=np.empty((len(spans), 0, robot.wheel_count)),
        spin=np.full(len(spans), np.nan),
        spans=tuple(spans),
        sample_time=sample_time,
    )


def _averaged(values: Floats) -> Floats:
    """Return each row (N, k) as the mean over `SMOOTHED` neighbours on either side; NaN near the ends."""
    ends = np.full((SMOOTHED, values.shape[1]), np.nan)
    means = np.lib.stride_tricks.sliding_window_view(values, 2 * SMOOTHED + 1, axis=0).mean(axis=-1)
    return np.vstack([ends, means, ends])


def momentum_balance(
    robot: Robot, logs: Sequence[Log], *, duration: float, without: Sequence[Span]
) -> Residuals:
    """Return the experiment on windows of a duration [s], `without` some; residuals [N m s] of turning pieces."""
    ball, h = ClampedBall.of_robot(robot), common_sample_time(logs, duration=duration)
    A, J, n = ball.A, robot.ball.inertia * np.eye(3), robot.wheel_count
    # ball.inertia is J + (j_w + j_r) A^T A
    of_wheels = (ball.inertia - J) @ np.linalg.pinv(A.T @ A)
    samples, length = round(duration / h), max(2, round(min(PIECE, duration) / h))
    skipped = {(span.log, span.start) for span in without}
    pieces, begins, largest = [], list[tuple[int, float]](), 0.0
    for number, log in enumerate(logs):
        seen = _BallLog(robot, log)
        w, omega, u = map(_averaged, (seen.wheel_speeds, seen.omega, seen.torques))
        valid = seen.valid & np.isfinite(w).all(axis=1)
        largest = max(largest, float(np.abs(seen.torques[valid]).max(initial=0.0)))
        momentum = omega @ J + w @ A @ of_wheels
        between, turned = (0.5 * (of[:-1] + of[1:]) for of in (w, omega))
        impulse = h * u @ A
        for start in seen.tiles(samples):
            begin = (number, float(log.t[start]))
            for k in range(start, start + samples - length + 1, length) if begin not in skipped else ():
                rows = slice(k - SMOOTHED, k + length + SMOOTHED + 1)
                turning = (np.abs(w[rows]) > SLOW).all(axis=0)
                if not (turning.any() and valid[rows].all()):
                    continue
                if not begins or begins[-1] != begin:
                    begins.append(begin)
                # onto the directions in which only wheels act that turn throughout the piece
                projector = np.eye(3) - np.linalg.pinv(A[~turning]) @ A[~turning]
                change = momentum[k + length] - momentum[k] - impulse[k : k + length].sum(axis=0)
                piece = between[k : k + length], turned[k : k + length].sum(axis=0)
                pieces.append((projector, projector @ change, *piece, len(begins) - 1))
    columns = zip(*pieces, strict=True) if pieces else np.empty((5, 0))
    projector, change, speeds, turned, window = (np.array(column) for column in columns)
    speeds = speeds.reshape(-1, length, n)
    # all but v_s and delta
    linear = np.append(np.ones(3 * n), [0.0, 0.0, 1.0])

    def derivatives(values: Floats) -> Floats:
        """Return the derivatives (3 m, p) of the impulse of friction by the parameters."""
        v_s, delta = values[-3:-1].tolist()
        ratio = np.maximum(np.abs(speeds) / v_s, np.finfo(float).tiny)
        fading = np.sign(speeds) * stribeck_curve(0.0, 1.0, ratio, delta)
        of_wheels = [part.sum(axis=1)[:, None, :] * A.T for part in (speeds, np.sign(speeds), fading)]
        shape = fading * ratio**delta * values[2 * n : 3 * n]
        of_all = [(shape * factor).sum(axis=1) @ A for factor in (delta / v_s, -np.log(ratio))]
        X = h * projector @ np.concatenate([*of_wheels, np.stack([*of_all, turned], axis=2)], axis=2)
        return X.reshape(change.size, -1)

    # friction is below the largest torque, and so is its viscous part at the usual speed
    most = largest / float(np.sqrt(np.mean(speeds**2))) if speeds.size else largest
    dry = (0.0, largest)
    bounds = Bounds({"viscous": (0.0, most), "coulomb": dry, "stribeck": dry, "stribeck_speed": SHAPES})
    drivelines = scale_between(robot.replace(friction=Friction.none(n)), free=_SHAPE[1:], bounds=bounds)
    B = FitParameter.about("B", 0.0, "N m s/rad", within=most)  # signed: a bound has no standard error
    return residuals_without_states(
        lambda values: change.ravel() + derivatives(values) @ (linear * values),
        parameters=(*drivelines.parameters[:-1], B),
        dependences=(Dependence(through="stribeck", dependent=_SHAPE),),
        block=np.repeat(window.astype(np.int64), 3),
        block_log=np.array([number for number, _ in begins], dtype=np.int64),
        derivatives_of=derivatives,
    )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class UpsideDown(Reported):
    """Friction without the robot's weight on the ball, p = 3 n + 2 parameters; `plot()` shows it over speed."""

    robot: Robot  #: with the identified friction; its rolling friction is unchanged
    described: Robot  #: as its file describes it
    models: Mapping[str, tuple[ClampedBall, Friction]]  #: that predict: "found", "robot file", "none"
    verdict: Verdict  #: whether the friction is usable
    estimate: StageEstimate  #: b, c and s of each wheel, v_s and delta (p,); errors clustered by window
    held_out: Mapping[str, Floats]  #: RMSE (3,) [rad/s] of `models`
    fit_windows: tuple[Span, ...]
    held_out_windows: tuple[Span, ...]
    window: float  #: length of a window [s]
    findings: tuple[Finding, ...]  #: of the numbers

    @property
    def parameters(self) -> ParameterTable:
        """{b: [..], c: [..], s: [..], v_s, delta}, SI units; the last two are NaN if no wheel has s."""
        return _by_symbol(self.estimate.values)

    @property
    def standard_errors(self) -> ParameterTable:
        """Standard errors, as `parameters`; NaN for a friction of zero."""
        return _by_symbol(self.estimate.errors)

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % intervals by label, of parameters with a standard error."""
        own, half = self.estimate, QUANTILE * self.estimate.errors
        ends = zip(np.maximum(own.values - half, 0.0).tolist(), (own.values + half).tolist(), strict=True)
        by_label = dict(zip(own.labels, ends, strict=True))
        return {label: interval for label, interval in by_label.items() if np.isfinite(interval[1])}


def _by_symbol(numbers: Floats) -> dict[str, list[float] | float]:
    b, c, s = numbers[:-2].reshape(3, -1).tolist()
    return {"b": b, "c": c, "s": s, "v_s": float(numbers[-2]), "delta": float(numbers[-1])}


def identify_upside_down(
    robot: RobotLike,
    logs: LogsLike,
    *,
    window: float = 1.0,
    held_out: float = 0.25,
    run: Run = DEFAULT_RUN,
) -> UpsideDown:
    """Identify b, c, s of each wheel, v_s and delta from the robot clamped upside down.

    InputError if the logs do not determine the parameters, or an option is invalid.

    Parameters
    ----------
    robot : Robot, preset or robot file
        Its friction is only compared with the result.
    logs : Log or log file, or several in a list or a mapping
        With u1 .. un and ball_omega_x, _y, _z in the robot's frame, at one sample time. Logged wheel speeds or angles
        are used.
    window : float
        Length of the windows [s], which cluster errors, and are held out and predicted.
    held_out : float
        Share of the windows that the fit does not see.
    run : Run, optional
        Its seed draws the held-out windows.

    Examples
    --------
    >>> robot = Robot.load("alten").replace({"friction.coulomb": 0.1})
    >>> t = 0.005 * np.arange(8001)
    >>> torques = 0.4 * np.sin(np.outer(t, [1.3, 1.9, 2.7]) + [0.0, 2.0, 4.0])  # [N m]
    >>> ball = ClampedBall.of_robot(robot)
    >>> omega = simulate_balls(
    ...     ball, friction=robot.friction, initial=[np.zeros(3)], torques=[torques[:-1]], sample_time=0.005
    ... )[0]
    >>> columns = dict(zip(BALL_NAMES, np.vstack([np.zeros(3), omega]).T))
    >>> log = Log({"t": t, **dict(zip(("u1", "u2", "u3"), torques.T)), **columns})
    >>> np.round(identify_upside_down("alten", log).parameters["c"], 2)  # [N m]
    array([0.1, 0.1, 0.1])
    """
    if not 0.0 < held_out < 1.0:
        raise InputError(f"held_out is {held_out!r}; it must be a fraction between 0 and 1, such as 0.25.")
    robot, named = as_robot(robot), as_logs(logs)
    n, everything = robot.wheel_count, list(named.values())
    windows = cut_ball_windows(robot, everything, duration=window)
    order = np.random.default_rng(run.seed).permutation(len(windows))
    held_rows, fit_rows = map(np.sort, np.split(order, [max(1, round(held_out * len(windows)))]))
    kept = windows.take(held_rows)
    experiment = momentum_balance(robot, everything, duration=window, without=kept.spans)
    if not np.any(windows.torques):
        raise InputError("The torques u are zero in every window; friction shows only while motors work.")
    # delta may be held, and B is no result
    fitted, count = len(experiment.block_log), 3 * n + 1
    if fitted < WINDOWS_PER_PARAMETER * count:
        raise InputError(
            f"In {fitted} windows a wheel turns faster than {SLOW:g} rad/s; to fit {count} parameters needs "
            f"{WINDOWS_PER_PARAMETER * count}. Use larger torques, log for longer, or choose a shorter window."
        )
    run.progress(Progress(stage="fit", done=0, total=2))
    own, loss, findings = _estimated(experiment, seed=run.seed)
    source = "a log" if len(named) == 1 else f"{len(named)} logs"
    identified = robot_with_friction(robot, own, source=f"identified: {source} upside down")
    run.progress(Progress(stage="prediction", done=1, total=2))
    ball, none = ClampedBall.of_robot(robot), Friction.none(n)
    models = {"found": (replace(ball, loss=loss), identified.friction)}
    models |= {"robot file": (ball, robot.friction)} if robot.friction != none else {}
    models |= {"none": (ball, none)}
    squares = {
        name: ((predicted_velocity(kept, *model) - kept.measured) ** 2).mean(axis=1)
        for name, model in models.items()
    }
    verdict = verdict_of(squares["found"], squares["none"], kept.spans)
    if not verdict.usable and not np.any(own.values[: 2 * n] > QUANTILE * own.errors[: 2 * n]):
        verdict = replace(verdict, reasons=("no friction was found", *verdict.reasons))
    return UpsideDown(
        robot=identified,
        described=robot,
        models=models,
        verdict=verdict,
        estimate=own,
        held_out={name: np.sqrt(square.mean(axis=0)) for name, square in squares.items()},
        fit_windows=windows.take(fit_rows).spans,
        held_out_windows=kept.spans,
        window=windows.torques.shape[1] * windows.sample_time,
        findings=(*findings, *file_findings(robot, own)),
    )


def _estimated(experiment: Residuals, *, seed: int) -> tuple[StageEstimate, float, list[Finding]]:
    """Return the friction with its covariance, B, and findings on what the logs do not show or disagree on."""
    space, findings = experiment.coordinates, list[Finding]()
    held = replace(experiment, coordinates=space.holding("stribeck_exponent"))
    # v_s may have several minima
    slow, fast = (
        held.coordinates.scaled(np.append(0.1 * space.upper[:-3], [v_s, 1.0, 0.0])) for v_s in (0.3, 1.0)
    )
    result = fit(held, slow, also=fast)
    if result.estimated[-3]:
        result = released(result, experiment, "stribeck_exponent", deviation=DELTA_DEVIATION)
        findings += [DELTA_HELD] if result.moved is not None else []
    else:
        text = "Break-away friction above c does not lower the error beyond chance; s is held at 0."
        findings.append(note("no-breakaway", text))
        held = replace(experiment, coordinates=space.holding("stribeck", *_SHAPE))
        result = fit(held, held.coordinates.scaled(result.values))
    apart = discrepancy(result.finished.equations, experiment.block_log, result.estimated, seed=seed)
    if apart.significant:
        text = "The logs disagree on the friction by more than chance; errors are wider."
        findings.append(warning("logs-differ", text))
    values, covariance = result.values, apart.factor**2 * result.covariance
    values[-3:-1] = np.where(result.estimated[-3], values[-3:-1], np.nan)
    lost = plus_minus(values[-1], covariance[-1, -1] ** 0.5)
    text = f"Where wheels touch the ball, it loses {lost} N m s/rad. A robot file has no such loss; b is without it."
    findings.append(note("contacts", text))
    own = StageEstimate("the logs upside down", space.labels[:-1], values[:-1], covariance[:-1, :-1])
    return own, float(values[-1]), findings

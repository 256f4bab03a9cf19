"""The Kalman filter's model of robot and sensors, with the noise it assumes and its two linear steps.

    14 states     b        (3) gyro bias, body frame [rad/s]
                  r        drift rate of the AHRS's heading [rad/s], b_z a part of it: the AHRS integrates that gyro
                  a        (2) slow error of the AHRS's g [-]
                  g        (2) x and y of the upward direction in the body's frame, its lean [-]
                  s        (2) momentum about the floor's contact as a speed, heading frame [m/s]
                  psi      heading: R = Rz(psi) M(g), M the shortest turn that takes g upright [rad]
                  psi_a    the AHRS's heading, psi and its error [rad]
                  x y      position of the ball, world frame [m]

    motion        w = gyro - b                   g_dot = g x w
                  psi_dot = w . (g + e_z) / (1 + g_z)
                  v = s - C w                    s_dot = -Lambda (g + kappa v/|v|) - psi_dot e_z x s
                  (x, y)_dot = Rz(psi) v         a_dot = -a / tau,  psi_a_dot = psi_dot + r

    the wheels    Omega = M(g) (T_obw wheel_speed + w)      the ball's angular velocity, heading frame
                  v = r_b (Omega_y, -Omega_x)    Omega_z = 0
    the AHRS      g + a,  psi_a
    a fix         x, y, psi

C, Lambda and kappa are those of `ballbot.mechanics.model.contact_momentum`. F leaves kappa out. All but position and
heading is in frames that turn with the robot. With velocity or lean in the world frame, each new linearisation point
would create spurious information on the heading (tried: after three minutes the filter claimed 0.5 degrees and was
wrong by 3 to 6). This psi differs from the state's by 2 atan(tan(theta/2) tan(phi/2)), 0.035 degrees at leans of 2.

The AHRS's heading is a state, and not its error: without a fix the variances of psi and of the error grow, equal but
for the tenth of a degree to which the AHRS keeps psi_a known, and single precision lost that within ten minutes.

Measured numbers are absorbed one after the other, each as a row h of the measurement matrix with its own variance r,
so that no matrix is inverted. With q = P h and s = h^T q + r it is

    k = q / s        P+ = P - k q^T

whose k is that of P but for rounding. (Joseph's form, which adds what k's rounding changes, -(q - s k) k^T, was tried:
an hour in single precision leaves double precision by the same 0.005 standard deviations at 200 Hz and 0.03 at 1 kHz,
and an update takes a Cortex-M4 26 % more instructions.)

The filter is written once, here: compiled for robots side by side (`sample_code`), in rows of a work array with a robot
a column (`ballbot.mechanics.engine.lanes`; a single filter is a block of one), and written as C by
`tests.support.kalman_header`. A new sensor is an entry of `SENSORS` with its noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from ballbot.arrays import Floats
from ballbot.mechanics.engine.compiled import c_code, compiled
from ballbot.mechanics.engine.elementary import sine_cosine
from ballbot.mechanics.engine.lanes import entry, put, restored, stored
from ballbot.mechanics.engine.tracing import either, greatest, lanes, outside, root, traced, where
from ballbot.mechanics.engine.vector import add, dot, inner, scale, subtract, summed
from ballbot.mechanics.floor import SLOW
from ballbot.mechanics.geometry import transforms
from ballbot.records import MAX_WHEELS, number, schema_of
from ballbot.robot import Robot
from ballbot.robot.derived import encoder_step

#: of a standing ball's pivoting, the density times the arm of what resists it: of those of 1 and 2 mm on the twin
#: [m rad/sqrt(s)]
_CREEP = 5e-6


@dataclass(frozen=True, kw_only=True)
class FilterNoise:
    """Standard deviations and densities; a density is that of an integral of white noise after one second.

    The defaults are of the thesis's robot with an AHRS of the Xsens MTi 1-series; those that are not a sensor's own
    were taken from the twin, with its rollers, play and rolling friction.
    """

    gyro: float  #: of each sample [rad/s]
    attitude: float  #: white part of the AHRS's angles [rad]
    heading_drift: float  #: drift rate of the AHRS's heading besides that gyro's bias [rad/s]
    heading_drift_walk: float = 1e-5  #: how that changes [rad/s/sqrt(s)]
    heading_walk: float = 1e-4  #: the AHRS's heading besides [rad/sqrt(s)]
    gyro_bias: float = math.radians(0.2)  #: at the start [rad/s]
    heading_bias: float = gyro_bias  #: about the body's axis: the AHRS's drift, if that is less [rad/s]
    gyro_bias_walk: float = 1e-5  #: [rad/s/sqrt(s)]
    lean_error: float = math.radians(0.2)  #: slow part of the AHRS's lean error [rad]
    lean_error_time: float = 10.0  #: correlation time of that error [s]
    push: float = 0.014  #: of the momentum, by external pushes [m/s/sqrt(s)]
    rolling: float = 1e-3  #: of the distance by the wheels: rollers, play, slip [m/sqrt(s)]
    pivoting: float = 3e-3  #: of the ball's pivoting by the wheels [rad/sqrt(s)]
    #: by which a count of each encoder moves the ball forward and to the left [m], and turns it [rad]: the root of the
    #: sum of squares over the wheels
    counts: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pivoting_time: float = 1.0  #: over which what they show is averaged [s]
    pivoted_time: float = 2.0  #: over which that mean's squares are averaged, which add to that density [s]
    start_position: float = 1e-3  #: of the position given at the reset [m]
    start_heading: float = 1e-3  #: of the AHRS's heading at the reset [rad]
    #: the robot stands still at the reset [m/s]; with ten times this doubt the first samples follow the motors through
    #: their play, and a stiff controller falls within a second
    start_speed: float = 0.005

    @staticmethod
    def of(robot: Robot) -> FilterNoise:
        """Return the noise of a robot's own sensors; a perfect sensor gets a very small noise."""
        sensors = robot.sensors
        step = encoder_step(robot)
        by_x, by_y, by_z = (step * np.linalg.norm(transforms(robot).T_obw, axis=1)).tolist()
        arm = robot.friction.pivoting
        return FilterNoise(
            pivoting=math.hypot(FilterNoise.pivoting, _CREEP / arm if arm else 0.0),
            counts=(robot.ball.radius * by_y, robot.ball.radius * by_x, by_z),
            gyro=max(sensors.gyro_noise, 1e-5),
            heading_bias=min(abs(sensors.heading_drift) or math.inf, FilterNoise.gyro_bias),
            attitude=max(sensors.attitude_noise, 1e-5),
            heading_drift=max(abs(sensors.heading_drift), 1e-5),
        )


#: the states in their order. Those that no other state drives come first
STATE_NAMES = (
    *("B_X", "B_Y", "B_Z", "DRIFT", "A_X", "A_Y"),
    *("G_X", "G_Y", "S_X", "S_Y", "PSI", "SHOWN_PSI", "X", "Y"),
)
STATES = len(STATE_NAMES)
#: where each state, or the first of its numbers, lies
BIAS, DRIFT, LEAN_ERROR, G, S, PSI, SHOWN_PSI, X = (
    STATE_NAMES.index(name) for name in ("B_X", "DRIFT", "A_X", "G_X", "S_X", "PSI", "SHOWN_PSI", "X")
)
#: states that are known from the start only together: of the AHRS's values each shows both, and its heading's rate
#: over the gyro's shows r - b_z
SHOWN_TOGETHER = ((LEAN_ERROR, G), (LEAN_ERROR + 1, G + 1), (PSI, SHOWN_PSI), (BIAS + 2, DRIFT))
#: states that nothing but a fix shows. Once the variance of one is above `FORGOTTEN_ABOVE` [rad^2, m^2], each sample
#: multiplies their errors by `REMEMBERED`: without a fix they grow, until what a sample adds is lost in rounding
UNSEEN = (PSI, X, X + 1)
FORGOTTEN_ABOVE = 0.04
REMEMBERED = 1.0 - 2.0**-18


class Numbers(NamedTuple):
    """The first numbers of a `KalmanRecord` as tuples."""

    sample_time: float
    radius: float
    ball_turn: tuple
    lever: tuple
    pull: tuple
    rolling: float
    forgotten: float


_THREE, _TWO = (0.0, 0.0, 0.0), (0.0, 0.0)
MODEL_SHAPE = Numbers(0.0, 0.0, ((0.0,) * MAX_WHEELS,) * 3, (_THREE, _THREE), (_TWO, _TWO), 0.0, 0.0)

# --- the motion ---


@traced
def upright_part(lean):
    """Return g_z; a lean that noise has taken past level counts as nearly level."""
    return root(greatest(1.0 - lean[0] * lean[0] - lean[1] * lean[1], 1e-6))


def lean_rate(lean, w):
    """Return x and y of g x w."""
    g_z = upright_part(lean)
    return (lean[1] * w[2] - g_z * w[1], g_z * w[0] - lean[0] * w[2])


def heading_rate(lean, w):
    """Return psi_dot = w . (g + e_z) / (1 + g_z) [rad/s]."""
    return w[2] + (w[0] * lean[0] + w[1] * lean[1]) / (1.0 + upright_part(lean))


def _momentum_rate(momentum, lean, turning, pull):
    """Return s_dot."""
    return (
        turning * momentum[1] - (pull[0][0] * lean[0] + pull[0][1] * lean[1]),
        -turning * momentum[0] - (pull[1][0] * lean[0] + pull[1][1] * lean[1]),
    )


def _ahead(a, rate, h):
    return (a[0] + h * rate[0], a[1] + h * rate[1])


def _turned(rows, first, second):
    return add(scale(rows[0], first), scale(rows[1], second))


def tilt(g):
    """Return M(g), the shortest turn that takes the direction g, given by x and y, upright, by its rows."""
    g_z = upright_part(g)
    share = 1.0 / (1.0 + g_z)
    return (
        (1.0 - share * g[0] * g[0], -share * g[0] * g[1], -g[0]),
        (-share * g[0] * g[1], 1.0 - share * g[1] * g[1], -g[1]),
        (g[0], g[1], g_z),
    )


def motion(model, x, gyro):
    """Return what a sample adds to the states before the place, and the means of v (2) [m/s] over it; gyro [rad/s]."""
    h, w = model.sample_time, subtract(gyro, x[BIAS : BIAS + 3])
    g, s = x[G : G + 2], x[S : S + 2]
    # second order: the rates at the sample's middle
    lean = _ahead(g, lean_rate(g, w), 0.5 * h)
    turning = heading_rate(lean, w)
    v = subtract(s, (dot(model.lever[0], w), dot(model.lever[1], w)))
    braked = scale(v, model.rolling / greatest(root(inner(v, v)), SLOW))
    momentum = _ahead(s, _momentum_rate(s, add(g, braked), turning, model.pull), 0.5 * h)
    by_g = scale(lean_rate(lean, w), h)
    by_s = scale(_momentum_rate(momentum, add(lean, braked), turning, model.pull), h)
    v = add(v, scale(by_s, 0.5))
    by_a = scale(x[LEAN_ERROR : LEAN_ERROR + 2], -model.forgotten)
    return (0.0, 0.0, 0.0, 0.0) + by_a + by_g + by_s + (h * turning, h * (turning + x[DRIFT])), v


#: the entries of F besides the unit matrix and what is forgotten: rows, which share it, and column
ENTRIES = (
    *(((G + i,), j) for i in (0, 1) for j in (G, G + 1)),
    *(((G,), BIAS + 1), ((G,), BIAS + 2), ((G + 1,), BIAS), ((G + 1,), BIAS + 2)),
    *(((S,), j) for j in (S + 1, G, G + 1, BIAS + 2)),
    *(((S + 1,), j) for j in (S, G, G + 1, BIAS + 2)),
    *(((PSI, SHOWN_PSI), j) for j in (G, G + 1, BIAS, BIAS + 1, BIAS + 2)),
    ((SHOWN_PSI,), DRIFT),
    *(((X + i,), j) for i in (0, 1) for j in (PSI, S, S + 1, BIAS, BIAS + 1, BIAS + 2)),
)


def transition(model, x, gyro, turn):
    """Return the `ENTRIES` of F: `motion` derived by the state, to first order in h; `turn` is (sin psi, cos psi)."""
    h, lever, pull = model.sample_time, model.lever, model.pull
    w, g = subtract(gyro, x[BIAS : BIAS + 3]), x[G : G + 2]
    g_z = upright_part(g)
    turning, over, rise = h * heading_rate(g, w), h / (1.0 + g_z), h / g_z
    v_x, v_y = x[S] - dot(lever[0], w), x[S + 1] - dot(lever[1], w)
    s3, c3 = scale(turn, h)
    along, across = _turned(lever, c3, -s3), _turned(lever, s3, c3)
    return (
        (rise * w[1] * g[0], h * w[2] + rise * w[1] * g[1])
        + (-(h * w[2] + rise * w[0] * g[0]), -(rise * w[0] * g[1]))
        + (h * g_z, -h * g[1], -h * g_z, h * g[0])
        + (turning, -h * pull[0][0], -h * pull[0][1], -h * x[S + 1])
        + (-turning, -h * pull[1][0], -h * pull[1][1], h * x[S])
        + (over * w[0], over * w[1], -over * g[0], -over * g[1], -h)
        + (h,)
        + (-(s3 * v_x + c3 * v_y), c3, -s3, *along)
        + (c3 * v_x - s3 * v_y, s3, c3, *across)
    )


#: the first state that others drive
DRIVEN = min(row for rows, _ in ENTRIES for row in rows)


def moved(model, x, gyro, turn_of: Callable):
    """Return what a sample adds to the state, and the means of v (2) [m/s] over it; gyro [rad/s].

    `turn_of` gives sine and cosine of an angle.
    """
    change, v = motion(model, x, gyro)
    s3, c3 = turn_of(x[PSI] + 0.5 * change[PSI])
    return change + scale((c3 * v[0] - s3 * v[1], s3 * v[0] + c3 * v[1]), model.sample_time), v


def faded(P: Callable, forgotten):
    """Return P's lower triangle, row by row, less what is forgotten of states' errors; P(i, j) is an entry, i >= j."""
    unknown = either(*(P(i, i) > FORGOTTEN_ABOVE for i in UNSEEN))
    left = dict.fromkeys(UNSEEN, where(unknown, REMEMBERED, 1.0))
    left |= dict.fromkeys((LEAN_ERROR, LEAN_ERROR + 1), 1.0 - forgotten)
    return [_product(P(i, j), left.get(i), left.get(j)) for i in range(STATES) for j in range(i + 1)]


def _product(number, *factors):
    """Return the product of a number and those factors that are not None."""
    for factor in factors:
        number = number if factor is None else number * factor
    return number


def carried(i: int, f: Sequence, column: Sequence):
    """Return element i of F times a column; F has the entries `f`."""
    row = [number * column[k] for number, (rows, k) in zip(f, ENTRIES, strict=True) if i in rows]
    return column[i] + summed(row) if row else column[i]


def propagated(FP: Sequence, f: Sequence, gyro_variance, walk: Sequence):
    """Return the lower triangle of F P F^T + Q, row by row, of the columns of F P; states walk by themselves.

    A sample's gyro noise does what a bias of one sample would: Q has F_b F_b^T gyro_variance, F_b the bias's columns of
    F, less the bias's own rows. It comes in with the second product if F P is larger by gyro_variance F_b in it.
    """
    by_bias = {
        (i, k): number for number, (rows, k) in zip(f, ENTRIES, strict=True) for i in rows if k < DRIFT
    }
    P = []
    for i in range(STATES):
        row = [column[i] for column in FP]
        shaken = [
            row[k] + gyro_variance * by_bias[i, k] if (i, k) in by_bias else row[k] for k in range(STATES)
        ]
        for j in range(i + 1):
            covariance = carried(j, f, shaken) if j >= DRIVEN else row[j]
            P.append(covariance + walk[i] if i == j else covariance)
    return P


# --- measurements ---


class Sensor(NamedTuple):
    """What one sensor shows: numbers that each have a row h of the measurement matrix."""

    name: str
    units: str  #: of its numbers
    states: tuple[tuple[int, ...], ...]  #: of each number those that it depends on, where h has entries
    #: (model, x, shown, gyro, v) -> residuals, and the entries of one row after the other. `shown` are the sensor's
    #: numbers at the sample's end, `gyro` [rad/s] and v [m/s] are means over it
    seen: Callable
    #: of each number, from noise and sample time [s]
    variances: Callable[[FilterNoise, float], tuple[float, ...]]


def wheels_seen(model, x, shown, gyro, v):
    """Return residuals and entries of v_x - r_b Omega_y = 0, v_y + r_b Omega_x = 0, -Omega_z = 0, first order in lean.

    `shown` is the ball's mean turning relative to the body, T_obw wheel_speed [rad/s].
    """
    r_b, lever, M = model.radius, model.lever, tilt(x[G : G + 2])
    z = add(shown, subtract(gyro, x[BIAS : BIAS + 3]))
    residuals = (r_b * dot(M[1], z) - v[0], -r_b * dot(M[0], z) - v[1], dot(M[2], z))
    # Omega by the lean: [[-z_z, 0], [0, -z_z], [z_x, z_y]]
    forward = (1.0, *add(lever[0], scale(M[1], r_b)), r_b * z[2])
    left = (1.0, *subtract(lever[1], scale(M[0], r_b)), -(r_b * z[2]))
    return residuals, forward + left + (*M[2], -z[0], -z[1])


def _sums(name: str, units: str, states: tuple[tuple[int, ...], ...], variances: Callable) -> Sensor:
    """Return a sensor each of whose numbers is the sum of some states."""

    def seen(_model, x, shown, _gyro, _v):
        expected = [summed([x[i] for i in those]) for those in states]
        return subtract(shown, expected), (1.0,) * sum(map(len, states))

    return Sensor(name, units, states, seen, variances)


def _wheel_variances(noise: FilterNoise, h: float) -> tuple[float, ...]:
    # a density over a sample: the mean speed of a distance that is a random walk; and the rounding of both counts
    walks = (noise.rolling, noise.rolling, noise.pivoting)
    x, y, turn = (
        walk**2 / h + count**2 / (6.0 * h * h) for walk, count in zip(walks, noise.counts, strict=True)
    )
    return x, y, turn


_BY_WHEELS = (
    (S, BIAS, BIAS + 1, BIAS + 2, G + 1),
    (S + 1, BIAS, BIAS + 1, BIAS + 2, G),
    (BIAS, BIAS + 1, BIAS + 2, G, G + 1),
)
_BY_AHRS = ((LEAN_ERROR, G), (LEAN_ERROR + 1, G + 1), (SHOWN_PSI,))
_FIX = _sums("fix", "m, m, rad", ((X,), (X + 1,), (PSI,)), lambda *_: (0.0, 0.0, 0.0))
#: sensors whose numbers come every sample
_EVERY_SAMPLE = (
    Sensor("wheels", "m/s, m/s, rad/s", _BY_WHEELS, wheels_seen, _wheel_variances),
    _sums("attitude", "1, 1, rad", _BY_AHRS, lambda noise, _: (noise.attitude**2,) * 3),
)
#: all, and last the fix, whose variances come with it
SENSORS = (*_EVERY_SAMPLE, _FIX)
#: of each seen number the states that it depends on
SEEN = tuple(states for sensor in SENSORS for states in sensor.states)
NUMBERS = len(SEEN)
_STARTS = accumulate((len(sensor.states) for sensor in SENSORS), initial=0)
#: place of each sensor's first number, by its name
FIRST = {sensor.name: start for sensor, start in zip(SENSORS, _STARTS, strict=False)}
#: sensors whose numbers a `Reading` has under their name, and the firmware's
DIRECT = tuple(sensor for sensor in SENSORS if sensor.name not in ("wheels", "attitude", "fix"))
#: place of each number's first entry
ENTRY_OF = tuple(accumulate((len(states) for states in SEEN), initial=0))
#: Omega_z, which is not zero where the ball pivots
PIVOTING_SEEN = FIRST["wheels"] + 2


def _triangle(i: int, j: int) -> int:
    """Return where an entry of a symmetric matrix is in its lower triangle, row by row."""
    return max(i, j) * (max(i, j) + 1) // 2 + min(i, j)


_TRIANGLE_SIZE = _triangle(STATES - 1, STATES - 1) + 1
#: where it has the states' variances, and the covariances of those known together
DIAGONAL = tuple(_triangle(i, i) for i in range(STATES))
TOGETHER = tuple(_triangle(i, j) for i, j in SHOWN_TOGETHER)
#: rows and columns of its entries, in their order
LOWER_TRIANGLE = np.tril_indices(STATES)


@dataclass(frozen=True, kw_only=True, eq=False)
class KalmanRecord:
    """The numbers of the Kalman filter."""

    sample_time: float = field(metadata=number("s"))
    radius: float = field(metadata=number("m"))  #: of the ball
    ball_turn: Floats = field(metadata=number("rad", 3, MAX_WHEELS))  #: T_obw of one encoder count
    lever: Floats = field(metadata=number("m", 2, 3))  #: C
    pull: Floats = field(metadata=number("m/s^2", 2, 2))  #: Lambda
    rolling: float = field(metadata=number("1"))  #: kappa
    forgotten: float = field(metadata=number("1"))  #: 1 - exp(-h / tau) of the slow lean error
    gyro_variance: float = field(metadata=number("rad^2/s^2"))  #: of a sample
    #: variance that each state gains in a sample by itself
    walk: Floats = field(metadata=number("square of the state", STATES))
    #: of what the sensors show every sample
    variances: Floats = field(metadata=number("square of what is shown", FIRST["fix"]))
    start_variances: Floats = field(metadata=number("square of the state", STATES))
    #: of a with g, of psi with psi_a, and of b_z with r
    start_covariances: Floats = field(metadata=number("1, rad^2, rad^2/s^2", len(SHOWN_TOGETHER)))
    pivoting_share: float = field(metadata=number("1"))  #: of a new sample in the mean of the pivoting
    pivoted_share: float = field(metadata=number("1"))  #: of that mean's square in the mean of the squares
    #: variance that Omega_z has besides, over the mean of that mean's squares
    pivoting_variance: float = field(metadata=number("1"))


KALMAN = schema_of(KalmanRecord)
KALMAN_TYPE = KALMAN.dtype()
#: where each field begins, in numbers
_PLACE = {name: place[1] // 8 for name, place in (KALMAN_TYPE.fields or {}).items()}

# Rows of a block's work array: a filter's model, as its record has it, and the variances of a fix; its state and
# covariance, a sample's inputs, and results on the way
_LEVER, _FORGOTTEN = _PLACE["lever"], _PLACE["forgotten"]
PIVOTING_SHARE, PIVOTED_SHARE = _PLACE["pivoting_share"], _PLACE["pivoted_share"]
PIVOTING_VARIANCE = _PLACE["pivoting_variance"]
START_VARIANCES, START_COVARIANCES = _PLACE["start_variances"], _PLACE["start_covariances"]
_GYRO_VARIANCE, _WALK, VARIANCES = _PLACE["gyro_variance"], _PLACE["walk"], _PLACE["variances"]
MODEL_SIZE = VARIANCES + NUMBERS
STATE = MODEL_SIZE
COVARIANCE = STATE + STATES
GYRO_BEFORE = COVARIANCE + _TRIANGLE_SIZE  #: at the sample's start [rad/s]
GYRO = GYRO_BEFORE + 3  #: at its end
SHOWN = GYRO + 3  #: what the sensors show, in the order of `SEEN`; NaN if missing
PIVOTING = SHOWN + NUMBERS  #: result: Omega_z as the wheels have it [rad/s]
_VELOCITY = PIVOTING + 1
_F = _VELOCITY + 2
_RESIDUAL = _F + len(ENTRIES)
_ROWS_SEEN = _RESIDUAL + NUMBERS
_CHANGE = _ROWS_SEEN + ENTRY_OF[-1]
ROWS = _CHANGE + STATES

_STATE_SHAPE, _TRIANGLE_SHAPE = (0.0,) * STATES, (0.0,) * _TRIANGLE_SIZE


def _inputs(work, lane):
    """Return a lane's model, its state, and the gyro's mean over the sample."""
    before, gyro = restored(_THREE, work, GYRO_BEFORE, lane), restored(_THREE, work, GYRO, lane)
    return restored(MODEL_SHAPE, work, 0, lane), state_in(work, lane), scale(add(before, gyro), 0.5)


@traced
def lever_in(work, lane):
    """Return a lane's C [m]."""
    return restored(MODEL_SHAPE.lever, work, _LEVER, lane)


@traced
def state_in(work, lane):
    """Return a lane's state (14)."""
    return restored(_STATE_SHAPE, work, STATE, lane)


@traced
def _move(work, width):
    """Move the states on by a sample; leave F and the mean velocity."""
    for lane in lanes(0, width):
        model, x, gyro = _inputs(work, lane)
        stored(work, _F, lane, transition(model, x, gyro, sine_cosine(x[PSI])))
        change, v = moved(model, x, gyro, sine_cosine)
        stored(work, STATE, lane, add(x, change))
        stored(work, _VELOCITY, lane, v)


@traced
def _propagate(work, width):
    """Overwrite the covariances by F P F^T + Q, less what is forgotten."""
    for lane in lanes(0, width):
        f = restored((0.0,) * len(ENTRIES), work, _F, lane)
        p = faded(_entries(restored(_TRIANGLE_SHAPE, work, COVARIANCE, lane)), entry(work, _FORGOTTEN, lane))
        P = _entries(p)
        columns = [[P(max(k, j), min(k, j)) for k in range(STATES)] for j in range(STATES)]
        FP = [[carried(i, f, column) for i in range(STATES)] for column in columns]
        walk = restored(_STATE_SHAPE, work, _WALK, lane)
        p = propagated(FP, f, entry(work, _GYRO_VARIANCE, lane), walk)
        stored(work, COVARIANCE, lane, tuple(p))


def _entries(p: Sequence) -> Callable:
    """Return a function of i and j, i >= j, that gives an entry of a lower triangle."""
    return lambda i, j: p[_triangle(i, j)]


def _absorb(work, width, sensors: Sequence[Sensor]):
    """Take in what sensors, known when compiling, show: one number after another."""
    for lane in lanes(0, width):
        stored(work, _CHANGE, lane, _STATE_SHAPE)
        for sensor in sensors:
            _compare(work, lane, sensor)
    for sensor in sensors:
        for shown in range(FIRST[sensor.name], FIRST[sensor.name] + len(sensor.states)):
            for lane in lanes(0, width):
                _take_in(work, lane, shown)
    for lane in lanes(0, width):
        change = restored(_STATE_SHAPE, work, _CHANGE, lane)
        stored(work, STATE, lane, add(state_in(work, lane), change))


def _compare(work, lane, sensor: Sensor):
    """Leave a sensor's residuals, NaN for what is missing, and its rows of H."""
    first, v = FIRST[sensor.name], restored(_TWO, work, _VELOCITY, lane)
    model, x, gyro = _inputs(work, lane)
    shown = restored((0.0,) * len(sensor.states), work, SHOWN + first, lane)
    present = tuple(number == number for number in shown)
    complete = tuple(where(yes, number, 0.0) for yes, number in zip(present, shown, strict=True))
    residuals, entries = sensor.seen(model, x, complete, gyro, v)
    residuals = tuple(where(yes, number, math.nan) for yes, number in zip(present, residuals, strict=True))
    stored(work, _RESIDUAL + first, lane, residuals)
    stored(work, _ROWS_SEEN + ENTRY_OF[first], lane, entries)
    if sensor.name == "wheels":
        put(work, PIVOTING, lane, residuals[PIVOTING_SEEN - first])


def projected(number: int, h: Sequence, P: Callable, change: Sequence):
    """Return q = P h of a number, h^T q, and what h expects of the changes; P(i, j) is an entry, i >= j."""
    states = SEEN[number]
    q = tuple(
        summed([P(max(i, j), min(i, j)) * partial for j, partial in zip(states, h, strict=True)])
        for i in range(STATES)
    )
    return q, inner(h, [q[j] for j in states]), inner(h, [change[j] for j in states])


def corrected(P: Callable, change: Sequence, q: Sequence, residual, inverse):
    """Return the lower triangle of P - q q^T / s, row by row, and the changes; `inverse` is 1 / s."""
    k = scale(q, inverse)
    left = [P(i, j) - k[i] * q[j] for i in range(STATES) for j in range(i + 1)]
    return left, add(change, scale(k, residual))


def _take_in(work, lane, number):
    """Correct a lane's state and covariance by a seen number, unless it is missing or does not count."""
    P = _entries(restored(_TRIANGLE_SHAPE, work, COVARIANCE, lane))
    h = restored((0.0,) * len(SEEN[number]), work, _ROWS_SEEN + ENTRY_OF[number], lane)
    change = restored(_STATE_SHAPE, work, _CHANGE, lane)
    q, spread, expected = projected(number, h, P, change)
    s, residual = entry(work, VARIANCES + number, lane) + spread, entry(work, _RESIDUAL + number, lane)
    residual = residual - expected
    taken = residual == residual
    p, change = corrected(P, change, q, where(taken, residual, 0.0), where(taken, 1.0 / s, 0.0))
    stored(work, COVARIANCE, lane, tuple(p))
    stored(work, _CHANGE, lane, change)


@traced
def _see_every_sample(work, width):
    _absorb(work, width, _EVERY_SAMPLE)


@cache
def sample_code() -> int:
    """Return the address of the code for `sample_block`; the first call compiles, or reads what was compiled."""

    @c_code("void(CPointer(float64), int64)")
    def address(work, width):
        _move(work, width)
        _propagate(work, width)
        _see_every_sample(work, width)

    return address


@traced
def sample_block(code, work, width):
    """Take the filters of the first lanes over a sample; the inputs are the rows from `VARIANCES` to `SHOWN`."""
    outside(code, work, width)


@traced
def _see_fix(work, width):
    _absorb(work, width, (_FIX,))


@compiled
def take_fix(work):
    """Take a fix into a single filter; its numbers are in the rows `SHOWN`, their variances in `VARIANCES`."""
    _see_fix(work, 1)

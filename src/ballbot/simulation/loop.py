"""The realistic closed loop, compiled: sensors, estimator, control law, drive and mechanics of robots side by side.

A sample of a robot is, in this order:

    measure     its true state, on its floor; encoders count, the AHRS is noisy, late, biased and drifts
    estimate    the on-board state or the Kalman filter, of the robot that the controller knows; or the true state
    decide      the control law (`ballbot.control.law`)
    drive       the torques wait for the delay; noise and the limits of driver and supply apply
    move        so many steps: the motors' lag, the gears' play or rigid gears, friction that sticks, pushes, bumps,
                rollers that come and go under the wheels; in the frame of a floor that slopes

Random numbers are drawn before (`Draws`). `SensedPlant` calls the same functions one sample at a time, with sensors,
estimator and controller in Python, and gives the same results to rounding.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.control.law import LIMIT_AT, MEMORY_SIZE, decide_torques
from ballbot.estimation.kalman_model import (
    BIAS,
    COVARIANCE,
    FIRST,
    GYRO,
    GYRO_BEFORE,
    LEVER,
    MODEL_SIZE,
    NUMBERS,
    PIVOTING,
    PIVOTS,
    PSI,
    SHOWN,
    SHOWN_PSI,
    G,
    S,
    X,
    sample_block,
    upright_part,
)
from ballbot.estimation.kalman_model import ROWS as FILTER_ROWS
from ballbot.estimation.kalman_model import STATE as FILTER_STATE
from ballbot.mechanics.engine.arrays import fill
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.mechanics.engine.lanes import (
    AHEAD,
    ANGLE,
    LANES,
    LOAD,
    MOTOR,
    PLAY,
    ROBOT,
    ROTOR,
    ROWS,
    STATE,
    STEP,
    TORQUE,
    entry,
    load,
    new_work,
    put,
    put_robot,
    robot_in,
    stored,
)
from ballbot.mechanics.engine.play import passed_torques, play_block, wheel_side
from ballbot.mechanics.engine.run import load_state, load_torques, start_lane, take_steps
from ballbot.mechanics.engine.smooth import SINES, SPEEDS, ball_velocity, body_velocity, in_state_order, pose
from ballbot.mechanics.engine.tracing import borrowed, lanes, traced
from ballbot.mechanics.engine.vector import add, dot, rotate_back
from ballbot.mechanics.equations import (
    LARGEST_LEAN,
    angle_rates,
    attitude,
    balancing_attitude,
    body_rates,
    rates_of_angles,
    solve,
    terms,
)
from ballbot.mechanics.parameters import RIGID_SIZE, WHEEL_COLUMNS, WHEEL_SIZE
from ballbot.simulation.imperfections import FALLING_PART
from ballbot.simulation.model_plant import friction_needed, sinking_with_speeds, wheel_forces

#: where a wheel's dry friction begins among its numbers: c, s and its terms, to the end
_DRY = WHEEL_COLUMNS["c"]
#: rows of the mechanics' work array, free between steps, with how fast a lane sinks at a sample's end, and the rates of
#: its angles
_SINKING, _RATES = SINES, SINES + 1
#: rows of a Kalman filter's work array with what these sensors show
_WHEELS, _AHRS = SHOWN + FIRST["wheels"], SHOWN + FIRST["attitude"]


class Inputs(NamedTuple):
    """Compiled code, and each robot's numbers; one row may hold for every robot."""

    code: int  #: of the mechanics' steps
    play_code: int  #: of steps with play; 0 without play
    law_code: int  #: 0 without laws
    filter_code: int  #: 0 without Kalman filters
    parameters: NDArray[np.float64]  #: rows of `pack`
    lift_offs: NDArray[np.float64]
    laws: NDArray[np.float64]  #: rows of `Controller.packed`, as long as the longest
    loops: NDArray[np.void]  #: records of `ballbot.simulation.imperfections.LOOP`
    filters: NDArray[np.float64]  #: rows of `filter_row`; no rows without a Kalman filter
    contacts: NDArray[np.float64]  #: rows of `pack_contacts`
    initial: NDArray[np.float64]
    pushes: NDArray[np.float64]  #: (robots, m, 6): first sample, first one after it, force [N], height [m]
    bumps: NDArray[np.float64]  #: (robots, m, 4): waves of the floor, their amplitudes times the weight [N m]


class Draws(NamedTuple):
    """The random numbers of a block's runs, a row for each robot; without columns if none are needed."""

    noise: NDArray[
        np.float64
    ]  #: standard normal: six of the AHRS, then for each sample n of the torques and six more
    faults: NDArray[np.float64]  #: standard normal: five at the start, then five for each sample
    positions: NDArray[np.float64]  #: (robots, n) of the motors in their play, -0.5 to 0.5
    turns: NDArray[
        np.float64
    ]  #: (robots, n) angles of the wheels at the start, from a roller of the first ring [rad]
    durations: NDArray[np.float64]  #: (robots, samples) of the samples; without columns all are alike [s]


class Sampling(NamedTuple):
    """The reference at each sample, the steps between, and when a lane is left."""

    references: NDArray[np.float64]  #: (samples, 10)
    sample_time: float  #: [s]
    steps: int  #: in a sample
    every: int  #: so many samples between records
    lost_lean: float  #: [rad] a lane that leans farther, and outward, is left
    grip: float  #: of the wheels on the ball; a lane that needs more is left


class Outcome(NamedTuple):
    """The arrays that the compiled call fills, for each robot."""

    states: NDArray[np.float64]  #: (robots, records, 10) at the start of each recorded sample
    finals: NDArray[np.float64]  #: (robots, 10) at the end of the run
    torques: NDArray[np.float64]  #: (robots, records, n)
    seen: NDArray[np.float64]  #: (robots, records, 10) the state that the controller was given
    commanded: NDArray[np.float64]  #: (robots, records, n) and what it asked for
    encoders: NDArray[
        np.float64
    ]  #: (robots, records, 2 n) the wheels' angles and speeds as they were measured
    gyro: NDArray[np.float64]  #: (robots, records, 3)
    ended: NDArray[np.int64]  #: sample in which it fell, lifted off or slipped; all samples if it did not
    lifted: NDArray[np.bool_]
    slipped: NDArray[np.bool_]
    changes: NDArray[np.float64]  #: sum of the squared changes of its torques


class Block(NamedTuple):
    """The loop's memory of each robot of a block, from sample to sample."""

    memories: NDArray[np.float64]  #: of the laws, rows that are records of `ballbot.control.law.MEMORY`
    by_steps: bool  #: whether the torques of any robot change within a sample
    late: NDArray[np.float64]  #: (1 + longest delay, robots, n) torques on their way
    wanted: NDArray[np.float64]  #: (robots, n) torques that the drivers want of the motors
    given: NDArray[np.float64]  #: (robots, n) those behind the motors' lag
    acting: NDArray[np.float64]  #: (robots, n) torques that act in a step
    commanded: NDArray[np.float64]  #: (robots, n) torques that the controllers ask for
    last: NDArray[np.float64]  #: (robots, n) and asked for in the last sample
    starts: NDArray[np.float64]  #: (robots, n) where motors with play begin to count [rad]
    angles: NDArray[np.float64]  #: (robots, n) of rigid motors [rad]
    speeds: NDArray[np.float64]  #: (robots, n) of rigid motors [rad/s]
    turns: NDArray[np.float64]  #: (robots, n) angles of the wheels at the start [rad]
    before: NDArray[np.float64]  #: (robots, n) encoder angles at the last sample
    encoders: NDArray[np.float64]  #: (robots, 2 n) encoder angles and the speeds differenced from them
    counted: NDArray[np.float64]  #: (robots, 1 + longest window, n) encoder angles at the last samples
    ahrs: NDArray[np.float64]  #: (robots, 6): biases, errors of the lean, heading of its frame
    readings: NDArray[np.float64]  #: (robots, 1 + longest latency, 6) gyro and attitude
    gyros: NDArray[np.float64]  #: (robots, 3) the gyro's present readings
    onboard: NDArray[np.float64]  #: (robots, 4) place and velocity
    pivoting: NDArray[np.float64]  #: (robots,) of the Kalman filters
    truths: NDArray[np.float64]  #: (robots, 10) states on the robots' floors
    states: NDArray[np.float64]  #: (robots, 10) that the controllers are given
    filters: NDArray[np.float64]  #: the Kalman filters' work array, a robot a column
    work: NDArray[np.float64]  #: the mechanics' work array
    # scratch of one robot
    wheels: NDArray[np.float64]  #: (n,) speeds
    rolled: NDArray[np.float64]  #: (n,) torques of the rollers
    attitude: NDArray[np.float64]  #: (3,) angles
    start: NDArray[np.float64]  #: (10,) state
    force: NDArray[np.float64]  #: (6,) as a row of `pushes`


@inlined
def _row_of(rows, robot):
    """Return the robot's row, where one row may hold for every robot."""
    return robot if len(rows) > 1 else 0


@inlined
def _loop_of(inputs, robot):
    return inputs.loops[_row_of(inputs.loops, robot)]


@inlined
def _floored(out, record, sign):
    """Add or subtract the lean of the floor, and that of a body off its axis from what is stepped."""
    out[2] += sign * record.floor_lean[0]
    out[3] += sign * record.floor_lean[1]
    x, y = sign * record.off_axis[0], sign * record.off_axis[1]
    if x != 0.0 or y != 0.0:
        s, c = math.sin(out[4]), math.cos(out[4])
        theta, phi = s * x + c * y, s * y - c * x
        out[2] += theta
        out[3] += phi
        out[7] -= out[9] * phi
        out[8] += out[9] * theta


@inlined
def _truth(work, lane, record, out):
    """Write a lane's state at a sample's end as it is on its floor."""
    for i in range(7):
        out[i] = entry(work, STATE + i, lane)
    for axis in range(3):
        out[7 + axis] = entry(work, _RATES + axis, lane)
    _floored(out, record, 1.0)


# --- sensors ---


@inlined
def _lean_and_heading(a, psi):
    """Return x and y of g = R^T e_z, and psi_s, of an `Attitude`; see `ballbot.mechanics.geometry`."""
    turn = a.sin_theta * a.sin_phi / ((1.0 + a.cos_theta) * (1.0 + a.cos_phi))
    return (a.R[2][0], a.R[2][1]), psi + 2.0 * math.atan(turn)


@inlined
def _angles_of(g, heading):
    """Return theta, phi, psi of the lean g and psi_s; psi has psi_s's turns (`attitude_of_swing`)."""
    g_z = upright_part(g)
    k = 1.0 / (1.0 + g_z)
    s, c = math.sin(heading), math.cos(heading)
    m11, m12, m22 = 1.0 - k * g[0] * g[0], -k * g[0] * g[1], 1.0 - k * g[1] * g[1]
    theta = math.atan2(s * g[0] + c * g[1], g_z)  # pyright: ignore[reportArgumentType] (floats here)
    phi = math.asin(max(-1.0, min(1.0, -c * g[0] + s * g[1])))
    # psi less psi_s, which is small: of both the sine and cosine over one positive factor
    sine, cosine = s * m22 - c * m12, c * m11 - s * m12
    return theta, phi, heading + math.atan2(c * sine - s * cosine, c * cosine + s * sine)


@inlined
def _read_ahrs(record, block, robot, sample, drawn, noise, faults, angles):
    """Fill the block's gyro and angles (3,) with what the AHRS shows."""
    truth, gyro = block.truths[robot], block.gyros[robot]
    a = attitude((truth[2], truth[3], truth[4]))
    rate = body_rates(a, (truth[7], truth[8], truth[9]))
    for i in range(3):
        gyro[i] = rate[i] + record.gyro_noise * noise[i]
        angles[i] = truth[2 + i] + record.attitude_noise * noise[3 + i]
    errors, drift = block.ahrs[robot], record.heading_drift * (sample * record.sample_time)
    if len(faults) > 0:
        if sample == 0:
            for i in range(3):
                errors[i] = record.gyro_bias * faults[i]
            for i in range(2):
                errors[3 + i] = record.lean_error * faults[3 + i]
        drift += errors[5]
        for i in range(3):
            gyro[i] += errors[i]
        angles[0] += errors[3]
        angles[1] += errors[4]
    if drift != 0.0:
        g, heading = _lean_and_heading(attitude((angles[0], angles[1], angles[2])), angles[2])
        turned = _angles_of(g, heading + drift)
        angles[0], angles[1], angles[2] = turned[0], turned[1], turned[2]
    if len(faults) > 0:
        fresh = faults[5 * (drawn + 1) : 5 * (drawn + 2)]
        errors[5] += record.sample_time * errors[2]
        for i in range(3):
            errors[i] += record.bias_step * fresh[i]
        for i in range(2):
            errors[3 + i] = record.lean_memory * errors[3 + i] + record.lean_step * fresh[3 + i]
    if record.latency > 0:
        readings = block.readings[robot]
        now = readings[sample % len(readings)]
        for i in range(3):
            now[i], now[3 + i] = gyro[i], angles[i]
        old = readings[max(sample - record.latency, 0) % len(readings)]
        for i in range(3):
            gyro[i], angles[i] = old[i], old[3 + i]


@inlined
def _read_encoders(record, block, robot, sample, angles, speeds):
    """Turn motor angles (n,) since the start into counted ones, and fill the speeds (n,) differenced from them."""
    recent = block.counted[robot]
    now, before = sample % len(recent), (sample - record.speed_window) % len(recent)
    for i in range(len(angles)):
        angles[i] = math.floor(angles[i] / record.count) * record.count
        recent[now, i] = angles[i]
        earlier = recent[before, i] if sample >= record.speed_window else 0.0
        speeds[i] = (angles[i] - earlier) / record.window_time


# --- on-board states ---


@inlined
def _ball_rate(record, speeds):
    """Return the ball's turning relative to the body [rad/s]."""
    x = y = z = 0.0
    for i in range(len(speeds)):
        x += record.ball_from_wheels[0, i] * speeds[i]
        y += record.ball_from_wheels[1, i] * speeds[i]
        z += record.ball_from_wheels[2, i] * speeds[i]
    return x, y, z


@inlined
def _onboard(record, block, robot, sample, speeds, gyro, angles, state):
    """Fill the state (10,) as `OnboardState` has it."""
    a, w = attitude((angles[0], angles[1], angles[2])), (gyro[0], gyro[1], gyro[2])
    z = add(_ball_rate(record, speeds), w)
    v = (record.known_radius * dot(a.R[1], z), -record.known_radius * dot(a.R[0], z))
    kept = block.onboard[robot]
    for i in range(2):
        if sample > 0:
            kept[i] += 0.5 * record.sample_time * (v[i] + kept[2 + i])
        kept[2 + i] = v[i]
        state[i], state[5 + i] = kept[i], v[i]
    rates = angle_rates(a, w)
    for i in range(3):
        state[2 + i], state[7 + i] = angles[i], rates[i]


@inlined
def _slot(row, robot):
    return row * LANES + robot


@inlined
def _begin_filter(filters, robot, row, state, gyro, angles):
    """Start a Kalman filter at its first reading; `row` is its row of `filter_row`."""
    for i in range(MODEL_SIZE):
        filters[_slot(i, robot)] = row[i]
    for i in range(len(row) - MODEL_SIZE - 2):
        filters[_slot(COVARIANCE + i, robot)] = row[MODEL_SIZE + i]
    g, heading = _lean_and_heading(attitude((angles[0], angles[1], angles[2])), angles[2])
    for i in range(2):
        lever = 0.0
        for k in range(3):
            lever += row[LEVER + 3 * i + k] * gyro[k]
        filters[_slot(FILTER_STATE + X + i, robot)] = state[i]
        filters[_slot(FILTER_STATE + G + i, robot)] = g[i]
        filters[_slot(FILTER_STATE + S + i, robot)] = lever  # v = 0
    filters[_slot(FILTER_STATE + PSI, robot)] = filters[_slot(FILTER_STATE + SHOWN_PSI, robot)] = heading
    for i in range(NUMBERS):
        filters[_slot(SHOWN + i, robot)] = np.nan


@inlined
def _show_filter(record, block, robot, limit, turned, gyro, angles):
    """Give a Kalman filter its inputs; `turned` (n,) are the mean wheel speeds over the sample."""
    filters = block.filters
    rate = _ball_rate(record, turned)
    g, heading = _lean_and_heading(attitude((angles[0], angles[1], angles[2])), angles[2])
    for i in range(3):
        filters[_slot(GYRO + i, robot)] = gyro[i]
        filters[_slot(_WHEELS + i, robot)] = rate[i]
    for i in range(2):
        filters[_slot(_AHRS + i, robot)] = g[i]
    filters[_slot(_AHRS + 2, robot)] = heading
    filters[_slot(PIVOTS, robot)] = 1.0 if abs(block.pivoting[robot]) > limit else 0.0


@inlined
def _filtered(filters, robot, gyro, state):
    """Fill the state (10,) of a Kalman filter, and keep the gyro for the next sample."""
    x = FILTER_STATE
    w = (
        gyro[0] - filters[_slot(x + BIAS, robot)],
        gyro[1] - filters[_slot(x + BIAS + 1, robot)],
        gyro[2] - filters[_slot(x + BIAS + 2, robot)],
    )
    for i in range(3):
        filters[_slot(GYRO_BEFORE + i, robot)] = gyro[i]
    for i in range(2):
        velocity = filters[_slot(x + S + i, robot)]
        for k in range(3):
            velocity -= filters[_slot(LEVER + 3 * i + k, robot)] * w[k]
        state[i], state[5 + i] = filters[_slot(x + X + i, robot)], velocity
    heading = filters[_slot(x + PSI, robot)]
    s3, c3 = math.sin(heading), math.cos(heading)
    state[5], state[6] = c3 * state[5] - s3 * state[6], s3 * state[5] + c3 * state[6]
    g = (filters[_slot(x + G, robot)], filters[_slot(x + G + 1, robot)])
    angles = _angles_of(g, heading)
    rates = angle_rates(attitude(angles), w)
    for i in range(3):
        state[2 + i], state[7 + i] = angles[i], rates[i]


# --- drive ---


@inlined
def _within_drive(record, torque, speed):
    """Return a torque near the motor's highest speed within what the supply leaves."""
    if abs(speed) < (1.0 - FALLING_PART) * record.top_speed:
        return torque
    share = (record.top_speed - math.copysign(speed, speed * torque)) / (FALLING_PART * record.top_speed)
    left = record.torque_limit * min(max(share, 0.0), 1.0)
    return min(max(torque, -left), left)


@inlined
def _within_supply(record, torques, speeds):
    """Limit torques (n,) to what a battery and the windings leave; see `Supply`."""
    power = 0.0
    for i in range(len(torques)):
        current = torques[i] / record.ampere
        power += torques[i] * speeds[i] + record.winding * current * current
    most = record.ampere * max(record.voltage - record.sag * power, 0.0) / record.winding
    for i in range(len(torques)):
        back = record.ampere * record.back / record.winding * speeds[i]
        torques[i] = min(max(torques[i], -most - back), most - back)


@inlined
def _push(selected, work, lane, record, push, duration):
    """Change a lane's velocities by the impulse of a push over a sample."""
    whole, state = load(selected, work, lane), load_state(selected, work, lane)
    P = wheel_side(whole, record.rotor_inertia if record.play > 0.0 else 0.0)
    a, v, w = attitude((state[2], state[3], state[4])), ball_velocity(state), body_velocity(state)
    p = (push[2] * duration, push[3] * duration, push[4] * duration)
    height = push[5]
    arm = (height * a.R[0][2], height * a.R[1][2], height * a.R[2][2])
    turning = (arm[1] * p[2] - arm[2] * p[1], arm[2] * p[0] - arm[0] * p[2], arm[0] * p[1] - arm[1] * p[0])
    system = terms(selected, P, a, v, w)
    v_change, w_change = solve(system, _along(v, p), rotate_back(a.R, turning))
    after = in_state_order(
        (state[0], state[1]), (state[2], state[3], state[4]), add(v, v_change), add(w, w_change)
    )
    stored(work, STATE, lane, after)


@traced
def _along(v, p):
    """Return an impulse p of the world as one on v."""
    return (p[0], p[1]) if len(v) == 2 else (p[0], p[1], 0.0)


@inlined
def _take_pushes(selected, work, lane, inputs, block, sampling, first, sample):
    """Let pushes, and the slope of the floor's bumps as a push at the ball's centre, act on a lane for a sample."""
    robot = robot_in(work, lane)
    pushes = inputs.pushes[_row_of(inputs.pushes, first + robot)]
    bumps = inputs.bumps[_row_of(inputs.bumps, first + robot)]
    for k in range(len(pushes) + min(len(bumps), 1)):
        push = block.force
        if k == len(pushes):
            x, y = block.truths[robot, 0], block.truths[robot, 1]
            push[2], push[3] = 0.0, 0.0
            for i in range(len(bumps)):
                size = bumps[i, 3] * math.cos(bumps[i, 0] * x + bumps[i, 1] * y + bumps[i, 2])
                push[2] -= size * bumps[i, 0]
                push[3] -= size * bumps[i, 1]
        else:
            push = pushes[k]
            if not pushes[k, 0] <= sample < pushes[k, 1]:
                continue
        record = _loop_of(inputs, first + robot)
        _push(selected, work, lane, record, push, sampling.sample_time)


@inlined
def _roll(selected, work, lane, inputs, record, block, number, since):
    """Let a lane's wheels touch the ball where their angles have them; fill `rolled` (n,) with the rollers' torques."""
    n, robot, rolled = block.acting.shape[1], robot_in(work, lane), block.rolled
    axles = inputs.parameters[_row_of(inputs.parameters, number)]
    _, speeds = pose(selected, load(selected, work, lane), load_state(selected, work, lane))
    fill(block.wheels, speeds)
    for i in range(n):
        rolled[i] = 0.0
    for i in range(n):
        angle = work[(ANGLE + i) * LANES + lane]
        if record.play == 0.0:
            angle = block.angles[robot, i] + since * block.speeds[robot, i]
        angle += block.turns[robot, i]
        nearest = math.floor(angle / record.pitch + 0.5)
        away = angle - nearest * record.pitch
        x = abs(away)
        y = record.pitch - x  # to the next roller
        further = record.out_of_round * (y * y * y * y - x * x * x * x)
        nearing = (
            4.0
            * record.out_of_round
            * (y * y * y + x * x * x)
            * math.copysign(block.wheels[i], away * block.wheels[i])
        )
        share = min(max(0.5 + 0.5 * (further - record.relaxation * nearing) / record.give, 0.0), 1.0)
        size = 4.0 * record.out_of_round * record.pressure * (share * x * x * x - (1.0 - share) * y * y * y)
        rolled[i] += math.copysign(1.0, away) * size
        # of neighbouring rollers one is of the first ring, one of the second
        ring = (2.0 * share - 1.0) * (2.0 * (nearest - 2.0 * math.floor(0.5 * nearest)) - 1.0)
        row = RIGID_SIZE + WHEEL_SIZE * i
        for k in range(3):
            work[(row + k) * LANES + lane] = axles[row + k] + ring * record.off_middle[i, k]
        turning = 0.0
        for j in range(n):
            turning += record.about_normal[i, j] * block.wheels[j]
        most = record.grip * min(share, 1.0 - share) * record.pressure
        moment = 2.0 * record.lever * min(max(record.creep * record.lever * turning, -most), most)
        for j in range(n):
            rolled[j] -= record.about_normal[i, j] * moment


@inlined
def _press(selected, work, lane, inputs, record, block, number):
    """Let the dry friction of a lane's wheels follow the forces between wheels and ball."""
    n, whole = block.acting.shape[1], load(selected, work, lane)
    P, u = whole, load_torques(selected, work, lane)
    if record.play > 0.0:
        P, u = wheel_side(whole, record.rotor_inertia), passed_torques(selected, work, lane)
    contacts = inputs.contacts[_row_of(inputs.contacts, number)]
    _, pressed = wheel_forces(selected, P, load_state(selected, work, lane), u, contacts)
    pressing = block.rolled
    fill(pressing, pressed)
    numbers = inputs.parameters[_row_of(inputs.parameters, number)]
    for i in range(n):
        share = max(0.0, 1.0 + record.load_dependence * (pressing[i] / record.pressure - 1.0))
        for row in range(RIGID_SIZE + WHEEL_SIZE * i + _DRY, RIGID_SIZE + WHEEL_SIZE * (i + 1)):
            work[row * LANES + lane] = share * numbers[row]


@inlined
def _put_torques(selected, work, width, inputs, block, first, h, since):
    """Let the torques act on the lanes for a step of h [s]: behind the motors' lag, and within what the supply leaves.

    The step begins `since` [s] after the sample. Gears with play have the motors' speeds of each step, rigid ones those
    of the sample.
    """
    for lane in range(width):
        robot = robot_in(work, lane)
        record, acting, speeds = _loop_of(inputs, first + robot), block.acting[robot], block.wheels
        if record.pitch > 0.0:
            _roll(selected, work, lane, inputs, record, block, first + robot, since)
        fill(acting, block.wanted[robot])
        if record.lag > 0.0:
            kept = math.exp(-h / record.lag)
            mean = (1.0 - kept) * record.lag / h
            for i in range(len(acting)):
                away = block.given[robot, i] - block.wanted[robot, i]
                acting[i] += mean * away
                block.given[robot, i] = block.wanted[robot, i] + kept * away
        for i in range(len(acting)):
            speeds[i] = work[(MOTOR + i) * LANES + lane] if record.play > 0.0 else block.speeds[robot, i]
            if record.limited == 1:
                acting[i] = _within_drive(record, acting[i], speeds[i])
        if record.limited == 2:
            _within_supply(record, acting, speeds)
        for i in range(len(acting)):
            load_on_wheel = -block.rolled[i] if record.pitch > 0.0 else 0.0
            if record.play > 0.0:
                work[(TORQUE + i) * LANES + lane], work[(LOAD + i) * LANES + lane] = acting[i], load_on_wheel
            else:
                work[(TORQUE + i) * LANES + lane] = acting[i] - load_on_wheel


# --- a block ---


@inlined
def _change(selected, work, width, inputs, block, first):
    """Go on with other numbers of the robots in the lanes; poses and velocities stay."""
    state = block.start
    for lane in range(width):
        robot = robot_in(work, lane)
        put_robot(work, lane, inputs.parameters[_row_of(inputs.parameters, first + robot)])
        fill(state, block.truths[robot])
        _floored(state, _loop_of(inputs, first + robot), -1.0)
        start_lane(selected, work, lane, state, work[STEP * LANES + lane])
        work[ROBOT * LANES + lane] = float(robot)


@inlined
def _start(selected, lane, inputs, draws, sampling, first, block):
    """Put a robot into its lane, at rest in its plays."""
    n, work, state, robot = block.acting.shape[1], block.work, block.start, robot_in(block.work, lane)
    record = _loop_of(inputs, first + robot)
    put_robot(work, lane, inputs.parameters[_row_of(inputs.parameters, first + robot)])
    fill(state, inputs.initial[_row_of(inputs.initial, first + robot)])
    for i in range(2):
        block.onboard[robot, i] = state[i]
    fill(block.truths[robot], state)
    _floored(state, record, -1.0)
    start_lane(selected, work, lane, state, sampling.sample_time / sampling.steps)
    work[ROBOT * LANES + lane] = float(robot)
    _, speeds = pose(selected, load(selected, work, lane), load_state(selected, work, lane))
    work[ROTOR * LANES + lane], work[PLAY * LANES + lane] = record.rotor_inertia, record.play
    for i in range(n):
        block.turns[robot, i] = draws.turns[robot, i]
        block.speeds[robot, i] = work[(MOTOR + i) * LANES + lane] = speeds[i]
        if record.play > 0.0:
            block.starts[robot, i] = record.play * draws.positions[robot, i]
            work[(AHEAD + i) * LANES + lane] = block.starts[robot, i]


@inlined
def _measure(selected, work, lane, inputs, draws, block, first, sample, drawn):
    """Read a lane's sensors, and fill its state unless the Kalman filter does; `drawn` is the sample in `draws`."""
    robot = robot_in(work, lane)
    record, state, n = _loop_of(inputs, first + robot), block.states[robot], block.acting.shape[1]
    fill(state, block.truths[robot])
    gyro, encoders, speeds = block.gyros[robot], block.encoders[robot, :n], block.encoders[robot, n:]
    for i in range(n):
        encoders[i], speeds[i] = block.angles[robot, i], block.speeds[robot, i]
        if record.play > 0.0:
            encoders[i] = (
                work[(ANGLE + i) * LANES + lane] + work[(AHEAD + i) * LANES + lane] - block.starts[robot, i]
            )
            speeds[i] = work[(MOTOR + i) * LANES + lane]
    if record.estimator == 0:
        rate = body_rates(attitude((state[2], state[3], state[4])), (state[7], state[8], state[9]))
        for i in range(3):
            gyro[i] = rate[i]
        return
    angles, noise = block.attitude, draws.noise[robot, (n + 6) * drawn : (n + 6) * drawn + 6]
    _read_ahrs(record, block, robot, sample, drawn, noise, draws.faults[robot], angles)
    _read_encoders(record, block, robot, sample, encoders, speeds)
    if record.estimator == 1:
        _onboard(record, block, robot, sample, speeds, gyro, angles, state)
        return
    row = inputs.filters[_row_of(inputs.filters, first + robot)]
    if sample == 0:
        _begin_filter(block.filters, robot, row, state, gyro, angles)
    else:
        turned = block.wheels
        for i in range(n):
            turned[i] = (encoders[i] - block.before[robot, i]) / record.sample_time
        _show_filter(record, block, robot, row[len(row) - 1], turned, gyro, angles)
    fill(block.before[robot], encoders)


@inlined
def _see(inputs, block, robot, first, sample):
    """Fill the state of a robot with a Kalman filter; a missing sample is no number."""
    record, state = _loop_of(inputs, first + robot), block.states[robot]
    if record.estimator == 2:
        row = inputs.filters[_row_of(inputs.filters, first + robot)]
        if sample > 0:
            pivoting = block.filters[_slot(PIVOTING, robot)]
            block.pivoting[robot] += row[len(row) - 2] * (pivoting - block.pivoting[robot])
        _filtered(block.filters, robot, block.gyros[robot], state)
    if record.missing_from <= sample < record.missing_until:
        state[0] = np.nan


@inlined
def _command(inputs, block, robot, first, reference):
    """Decide a robot's torques by its law."""
    state, held = block.states[robot], block.commanded[robot]
    fill(block.last[robot], held)
    row = _row_of(inputs.laws, first + robot)
    decide_torques(
        inputs.law_code, inputs.laws[row], block.memories[robot], state, reference, held, len(held)
    )


@inlined
def _drive(work, lane, inputs, block, first, sample, noise, changes):
    """Give motors the torques that are due, with noise (n,), within the driver's limit."""
    robot = robot_in(work, lane)
    record, held = _loop_of(inputs, first + robot), block.commanded[robot]
    late = block.late
    fill(late[sample % len(late), robot], held)
    due = late[(sample - record.delay) % len(late), robot]
    for i in range(len(held)):
        if sample > 0:
            changes[first + robot] += (held[i] - block.last[robot, i]) ** 2
        torque = due[i]
        if record.torque_noise > 0.0:
            torque += record.torque_noise * noise[i]
        if record.limited > 0:
            torque = min(max(torque, -record.torque_limit), record.torque_limit)
        block.wanted[robot, i] = torque
        if record.lag == 0.0:
            block.given[robot, i] = torque


def _ends(selected, work, width, plays):
    """Leave how fast each lane sinks, its angles turn and its wheels, in rows free between steps: vector code."""
    for lane in lanes(0, width):
        P, u = load(selected, work, lane), load_torques(selected, work, lane)
        if plays:
            P, u = wheel_side(P, entry(work, ROTOR, lane)), passed_torques(selected, work, lane)
        state = load_state(selected, work, lane)
        a = balancing_attitude((state[2], state[3], state[4]))
        falling, speeds = sinking_with_speeds(selected, P, state, u)
        put(work, _SINKING, lane, falling)
        stored(work, _RATES, lane, rates_of_angles(selected, a, body_velocity(state)))
        stored(work, SPEEDS, lane, speeds)


@traced
def _ends_with_play(selected, work, width):
    _ends(selected, work, width, True)


@traced
def _ends_without_play(selected, work, width):
    _ends(selected, work, width, False)


@inlined
def _turn_motors(selected, work, width, inputs, block, first, steps):
    """Look at the lanes at a sample's end; leave the speeds of rigid motors, and turn their encoders by the mean."""
    if _loop_of(inputs, first).play > 0.0:  # all robots of a block, or none
        _ends_with_play(selected, work, width)
        return
    _ends_without_play(selected, work, width)
    for lane in range(width):
        robot, duration = robot_in(work, lane), steps * work[STEP * LANES + lane]
        for i in range(block.speeds.shape[1]):
            speed = work[(SPEEDS + i) * LANES + lane]
            block.angles[robot, i] += 0.5 * duration * (block.speeds[robot, i] + speed)
            block.speeds[robot, i] = speed


@inlined
def _end_where_due(selected, work, lane, inputs, sampling, block, first, sample, out):
    """Stop a lane that has fallen within the sample, would lift off or slip at its end, or is lost."""
    robot = robot_in(work, lane)
    record, number = _loop_of(inputs, first + robot), first + robot
    lean = max(abs(work[(STATE + 2) * LANES + lane]), abs(work[(STATE + 3) * LANES + lane]))
    truth = block.truths[robot]
    _truth(work, lane, record, truth)
    fallen = work[STEP * LANES + lane] == 0.0 or not lean <= LARGEST_LEAN
    # 1 - (theta^2 + phi^2)/2 is at most the product of the cosines
    near = 1.0 - 0.5 * (truth[2] * truth[2] + truth[3] * truth[3]) < record.fallen_cosine
    fallen = fallen or (near and math.cos(truth[2]) * math.cos(truth[3]) < record.fallen_cosine)
    lost = truth[2] * truth[2] + truth[3] * truth[3] > sampling.lost_lean * sampling.lost_lean
    fallen = fallen or (lost and truth[2] * truth[7] + truth[3] * truth[8] > 0.0)
    if not fallen:
        if not work[_SINKING * LANES + lane] < inputs.lift_offs[_row_of(inputs.lift_offs, number)]:
            fallen = out.lifted[number] = True
        elif sampling.grip < math.inf:
            P, u = load(selected, work, lane), load_torques(selected, work, lane)
            if record.play > 0.0:
                P, u = wheel_side(P, record.rotor_inertia), passed_torques(selected, work, lane)
            state = load_state(selected, work, lane)
            touching = inputs.contacts[_row_of(inputs.contacts, number)]
            if not friction_needed(selected, P, state, u, touching) <= sampling.grip:
                fallen = out.slipped[number] = True
    if fallen:
        out.ended[number] = sample
        work[STEP * LANES + lane] = 0.0  # the lane stays where it is


@inlined
def _runs(work, lane, out, first, samples):
    robot = first + robot_in(work, lane)
    return out.ended[robot] == samples


def new_block(loops: NDArray[np.void], width: int, n: int, *, filtering: bool) -> Block:
    """Return the memory of a block whose robots all begin; n is the number of wheels."""
    return _new_memory(loops, width, n, blocks=(), filtering=filtering)


def new_blocks(loops: NDArray[np.void], lanes: int, n: int, *, filtering: bool) -> Block:
    """Return the memory of many robots, for `advance_block`."""
    memory = _new_memory(loops, lanes, n, blocks=(-(-lanes // LANES),), filtering=filtering)
    for k, work in enumerate(memory.work):
        width = min(LANES, lanes - k * LANES)
        work[ROBOT * LANES : ROBOT * LANES + width] = np.arange(width)
    return memory


def _new_memory(
    loops: NDArray[np.void], width: int, n: int, *, blocks: tuple[int, ...], filtering: bool
) -> Block:
    delay, latency = int(loops["delay"].max()), int(loops["latency"].max())
    window = max(1, int(loops["speed_window"].max()))
    by_steps = bool(((loops["lag"] > 0.0) | (loops["pitch"] > 0.0)).any())
    shapes = dict.fromkeys(Block._fields, (width, n)) | {
        "memories": (width, MEMORY_SIZE),
        "late": (1 + delay, width, n),
        "encoders": (width, 2 * n),
        "counted": (width, 1 + window, n),
        "ahrs": (width, 6),
        "readings": (width, 1 + latency, 6),
        "gyros": (width, 3),
        "onboard": (width, 4),
        "pivoting": (width,),
        "truths": (width, 10),
        "states": (width, 10),
        "filters": (*blocks, FILTER_ROWS * LANES if filtering else LANES),
        "wheels": (*blocks, n),
        "rolled": (*blocks, n),
        "attitude": (*blocks, 3),
        "start": (*blocks, 10),
        "force": (*blocks, 6),
    }
    arrays = {name: np.zeros(shape) for name, shape in shapes.items()}
    work = new_work.py_func()  # pyright: ignore[reportFunctionMemberAccess] (Numba's)
    if blocks:
        work = np.stack([work] * blocks[0])  # a row is a whole number of cache lines
    others = {"by_steps": by_steps, "work": work}
    return Block(**arrays | others)  # pyright: ignore[reportArgumentType]


@inlined
def _move(selected, work, width, inputs, block, sampling, first):
    """Move a block's robots on by a sample."""
    plays = _loop_of(inputs, first).play > 0.0  # all robots of a block, or none
    h = sampling.sample_time / sampling.steps
    for lane in range(width):
        robot = robot_in(work, lane)
        record = _loop_of(inputs, first + robot)
        if record.load_dependence > 0.0:
            _press(selected, work, lane, inputs, record, block, first + robot)
    if not (plays or block.by_steps):
        _put_torques(selected, work, width, inputs, block, first, h, 0.0)
        take_steps(inputs.code, work, width, sampling.steps)
        return
    for step in range(sampling.steps):
        _put_torques(selected, work, width, inputs, block, first, h, step * h)
        if plays:
            play_block(inputs.play_code, work, width)
        else:
            take_steps(inputs.code, work, width, 1)


@compiled
def run_block(selected, inputs, draws, sampling, block, first, width, span, out):
    """Run robots first .. first + width - 1 from a sample to another; `draws` and `block` are of these alone.

    Other inputs from a later sample on are a payload or a floor that has changed.
    """
    inputs, draws, sampling = borrowed(inputs), borrowed(draws), borrowed(sampling)
    block, out = borrowed(block), borrowed(out)
    samples, n = len(sampling.references), out.torques.shape[2]
    begin, end = span
    filtering, work = len(inputs.filters) > 0, block.work
    if begin == 0:
        for lane in range(width):
            work[ROBOT * LANES + lane] = float(lane)
            _start(selected, lane, inputs, draws, sampling, first, block)
    else:
        _change(selected, work, width, inputs, block, first)
    moving = 0
    for lane in range(width):
        moving += 1 if _runs(work, lane, out, first, samples) else 0
    for sample in range(begin, end):
        reference = sampling.references[sample]
        record, recorded = sample // sampling.every, sample % sampling.every == 0
        if recorded:
            for robot in range(width):
                fill(out.states[first + robot, record], block.truths[robot])
        if moving > 0:
            for lane in range(width):
                if _runs(work, lane, out, first, samples):
                    _measure(selected, work, lane, inputs, draws, block, first, sample, sample)
            if filtering and sample > 0:
                sample_block(inputs.filter_code, block.filters, width)
            for lane in range(width):
                if _runs(work, lane, out, first, samples):
                    robot = robot_in(work, lane)
                    noise = draws.noise[robot, (n + 6) * sample + 6 : (n + 6) * sample + 6 + n]
                    _see(inputs, block, robot, first, sample)
                    _command(inputs, block, robot, first, reference)
                    _drive(work, lane, inputs, block, first, sample, noise, out.changes)
                    if draws.durations.shape[1] > 0:
                        work[STEP * LANES + lane] = draws.durations[robot, sample] / sampling.steps
            for lane in range(width):
                _take_pushes(selected, work, lane, inputs, block, sampling, first, sample)
            _move(selected, work, width, inputs, block, sampling, first)
            _turn_motors(selected, work, width, inputs, block, first, sampling.steps)
        for lane in range(width):
            robot = first + robot_in(work, lane)
            if _runs(work, lane, out, first, samples):
                _end_where_due(selected, work, lane, inputs, sampling, block, first, sample + 1, out)
                moving -= 1 if work[STEP * LANES + lane] == 0.0 else 0
            if recorded:
                fill(out.torques[robot, record], block.acting[robot - first])
                fill(out.seen[robot, record], block.states[robot - first])
                fill(out.commanded[robot, record], block.commanded[robot - first])
                fill(out.encoders[robot, record], block.encoders[robot - first])
                fill(out.gyro[robot, record], block.gyros[robot - first])
    for robot in range(width):
        fill(out.finals[first + robot], block.truths[robot])


@compiled
def start_alone(selected, inputs, draws, sampling, block):
    """Set a robot whose controller is called from outside to its start."""
    _start(selected, 0, inputs, draws, sampling, 0, block)
    _measure(selected, block.work, 0, inputs, draws, block, 0, 0, 0)


@compiled
def change_alone(selected, inputs, block):
    """Go on with other numbers of such a robot."""
    _change(selected, block.work, 1, inputs, block, 0)


@compiled
def step_alone(selected, inputs, draws, sampling, block, sample, torques, out):
    """Move such a robot on by a sample of its controller's torques (n,); what it measures is then in the block.

    Of `draws`, the torques' noise (1, n) and the sample's duration (1, 1) are of this sample.
    """
    work = block.work
    fill(block.commanded[0], torques)
    _drive(work, 0, inputs, block, 0, sample, draws.noise[0], out.changes)
    work[STEP * LANES] = draws.durations[0, 0] / sampling.steps
    _take_pushes(selected, work, 0, inputs, block, sampling, 0, sample)
    _move(selected, work, 1, inputs, block, sampling, 0)
    _turn_motors(selected, work, 1, inputs, block, 0, sampling.steps)
    _end_where_due(selected, work, 0, inputs, sampling, block, 0, sample + 1, out)
    _measure(selected, work, 0, inputs, draws, block, 0, 0, 0)


# --- robots that are commanded from outside, each at its own sample ---

#: what is done with a robot: nothing, a sample on, or a start
LEFT, ADVANCED, STARTED = 0, 1, 2


class Commands(NamedTuple):
    """What robots that are commanded from outside are given, a row for each."""

    todo: NDArray[
        np.int64
    ]  #: `LEFT`, `ADVANCED` or `STARTED`; where any is advanced, only robots that ended are left
    ages: NDArray[np.int64]  #: samples since each robot's start
    torques: NDArray[np.float64]  #: (robots, n) beside those of the laws, if there are any
    references: NDArray[np.float64]  #: (robots, 10) for the laws


@inlined
def _zero(numbers):
    for i in range(len(numbers)):
        numbers[i] = 0.0


@inlined
def _clear(block, lane, robot):
    """Forget all that a robot has done."""
    for row in range(ROWS):
        block.work[row * LANES + lane] = 0.0
    block.work[ROBOT * LANES + lane] = float(robot)
    for row in range(len(block.filters) // LANES):
        block.filters[_slot(row, robot)] = 0.0
    for memory in (block.memories, block.wanted, block.given, block.commanded, block.last, block.angles):
        _zero(memory[robot])
    for memory in (block.before, block.ahrs, block.onboard):
        _zero(memory[robot])
    for late in range(len(block.late)):
        _zero(block.late[late, robot])
    for rows in (block.counted[robot], block.readings[robot]):
        for row in range(len(rows)):
            _zero(rows[row])
    block.pivoting[robot] = 0.0


@inlined
def draws_within(draws, a, b):
    """Return the random numbers of robots a .. b - 1."""
    return Draws(
        draws.noise[a:b], draws.faults[a:b], draws.positions[a:b], draws.turns[a:b], draws.durations[a:b]
    )


@inlined
def block_within(all_blocks, k, a, b):
    """Return the k-th block, of robots a .. b - 1, of the memory of many."""
    m = all_blocks
    return Block(
        m.memories[a:b],
        m.by_steps,
        m.late[:, a:b],
        m.wanted[a:b],
        m.given[a:b],
        m.acting[a:b],
        m.commanded[a:b],
        m.last[a:b],
        m.starts[a:b],
        m.angles[a:b],
        m.speeds[a:b],
        m.turns[a:b],
        m.before[a:b],
        m.encoders[a:b],
        m.counted[a:b],
        m.ahrs[a:b],
        m.readings[a:b],
        m.gyros[a:b],
        m.onboard[a:b],
        m.pivoting[a:b],
        m.truths[a:b],
        m.states[a:b],
        m.filters[k],
        m.work[k],
        m.wheels[k],
        m.rolled[k],
        m.attitude[k],
        m.start[k],
        m.force[k],
    )


@inlined
def advance_block(selected, inputs, draws, sampling, block, first, width, commands, out):
    """Take robots first .. first + width - 1 on by a sample, or start them; what each then sees is in the block.

    `draws` and `block` are of these alone. `draws` has numbers for some samples; the place of a robot's age in them is
    that modulo their number.
    """
    inputs, draws, sampling = borrowed(inputs), borrowed(draws), borrowed(sampling)
    block, commands, out = borrowed(block), borrowed(commands), borrowed(out)
    n, work, filtering = block.acting.shape[1], block.work, len(inputs.filters) > 0
    kept, moving = max(draws.noise.shape[1] // (n + 6), 1), 0
    for lane in range(width):
        robot = robot_in(work, lane)
        number = first + robot
        if commands.todo[number] != ADVANCED:
            work[STEP * LANES + lane] = 0.0  # the lane stays where it is
            continue
        moving += 1
        age, held = commands.ages[number], block.commanded[robot]
        drawn = age % kept
        if inputs.law_code == 0:
            fill(block.last[robot], held)
            fill(held, commands.torques[number])
        else:
            _command(inputs, block, robot, first, commands.references[number])
            limit = inputs.laws[_row_of(inputs.laws, number), LIMIT_AT]
            for i in range(n):
                held[i] = min(max(held[i] + commands.torques[number, i], -limit), limit)
                block.memories[robot, i] = held[i]  # the law's history begins with the torques that act
        noise = draws.noise[robot, (n + 6) * drawn + 6 : (n + 6) * drawn + 6 + n]
        _drive(work, lane, inputs, block, first, age, noise, out.changes)
        h = draws.durations[robot, drawn] if draws.durations.shape[1] > 0 else sampling.sample_time
        work[STEP * LANES + lane] = h / sampling.steps
        _take_pushes(selected, work, lane, inputs, block, sampling, first, age)
    if moving > 0:
        _move(selected, work, width, inputs, block, sampling, first)
        _turn_motors(selected, work, width, inputs, block, first, sampling.steps)
    for lane in range(width):
        robot = robot_in(work, lane)
        number = first + robot
        age = commands.ages[number] + 1
        if commands.todo[number] == ADVANCED:
            _end_where_due(selected, work, lane, inputs, sampling, block, first, age, out)
            _measure(selected, work, lane, inputs, draws, block, first, age, age % kept)
    if filtering and moving > 0:
        sample_block(inputs.filter_code, block.filters, width)
    for lane in range(width):
        robot = robot_in(work, lane)
        number, age = first + robot, commands.ages[first + robot] + 1
        if commands.todo[number] == STARTED:
            age = 0
            _clear(block, lane, robot)
            _start(selected, lane, inputs, draws, sampling, first, block)
            _measure(selected, work, lane, inputs, draws, block, first, 0, 0)
        if commands.todo[number] != LEFT:
            _see(inputs, block, robot, first, age)

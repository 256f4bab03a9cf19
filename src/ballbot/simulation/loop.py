"""The realistic closed loop, compiled: sensors, estimator, control law, drive and mechanics of robots side by side.

A sample of a robot is, in this order:

    measure     its true state, on its floor; encoders count, the AHRS is noisy, late, biased and drifts
    estimate    the on-board state or the Kalman filter, of the robot that the controller knows; or the true state
    decide      the control law (`ballbot.control.law`)
    drive       the torques wait for the delay; noise and the limits of driver and supply apply
    move        so many steps: the motors' lag, the gears' play or rigid gears, friction that sticks, contacts that
                slip, pushes, bumps, rollers that come and go under the wheels; in the frame of a floor that slopes

Random numbers are drawn before (`Draws`). `SensedPlant` calls the loop one sample at a time, with the sensors and the
estimator of one robot and a controller in Python, and gives the same results to rounding.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.control.law import LIMIT_AT, MEMORY_SIZE, decide_torques
from ballbot.estimation.kalman_front import FILTER_MEMORY_TYPE, reset_filter, see, show
from ballbot.estimation.kalman_model import ROWS as FILTER_ROWS
from ballbot.estimation.kalman_model import sample_block
from ballbot.estimation.known import Shown
from ballbot.estimation.onboard import ONBOARD_MEMORY_TYPE, onboard_reset, onboard_update
from ballbot.mechanics.contacts import wheel_side
from ballbot.mechanics.engine.arrays import fill
from ballbot.mechanics.engine.compiled import compiled, inlined, spliced
from ballbot.mechanics.engine.lanes import (
    AHEAD,
    ANGLE,
    BODY,
    FLOOR,
    GRIP,
    LANES,
    LOAD,
    MOTOR,
    PLAY,
    PRESSING,
    ROBOT,
    ROTOR,
    ROWS,
    SLIP,
    STATE,
    STEP,
    TORQUE,
    entry,
    load,
    new_work,
    put,
    put_robot,
    restored,
    robot_in,
    stored,
)
from ballbot.mechanics.engine.play import passed_torques, play_block
from ballbot.mechanics.engine.run import load_state, load_torques, start_lane, take_steps
from ballbot.mechanics.engine.smooth import SINES, SPEEDS, ball_velocity, body_velocity, in_state_order, pose
from ballbot.mechanics.engine.tracing import borrowed, lanes, traced
from ballbot.mechanics.engine.vector import add, rotate_back
from ballbot.mechanics.equations import (
    LARGEST_LEAN,
    attitude,
    balancing_attitude,
    body_rates,
    rates_of_angles,
    solve,
    terms,
)
from ballbot.mechanics.parameters import COLUMNS, RIGID_SIZE, WHEEL_COLUMNS, WHEEL_SIZE
from ballbot.robot.components import FALLING_PART
from ballbot.simulation.model_plant import friction_needed, sinking_with_speeds, wheel_forces
from ballbot.simulation.rollers import touch
from ballbot.simulation.sensors import SensorMemory, new_sensor_memory, read_sensors

#: where a wheel's dry friction begins among its numbers: c, s and its terms, to the end
_DRY = WHEEL_COLUMNS["c"]
_GRAVITY, _WEIGHT, _ML = COLUMNS["gravity"], COLUMNS["weight"], COLUMNS["ml"]
#: rows of the mechanics' work array, free between steps, with how fast a lane sinks at a sample's end, and the rates of
#: its angles
_SINKING, _RATES = SINES, SINES + 1


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
    filters: NDArray[np.float64]  #: records of `KALMAN`; no rows without a Kalman filter
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
    samples: int  #: that have numbers; a robot's sample takes those of its number modulo this


class Sampling(NamedTuple):
    """The reference at each sample, the steps between, and when a lane is left."""

    references: NDArray[np.float64]  #: (samples, 10)
    sample_time: float  #: [s]
    steps: int  #: in a sample
    every: int = 1  #: so many samples between records
    lost_lean: float = math.inf  #: [rad] a lane that leans farther, and outward, is left
    grip: float = math.inf  #: of the wheels on the ball; a lane that needs more is left


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


class LoopMemory(NamedTuple):
    """What the loop keeps of each robot, from sample to sample."""

    laws: NDArray[np.float64]  #: memories of the laws, rows that are records of `ballbot.control.law.MEMORY`
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
    encoders: NDArray[np.float64]  #: (robots, 2 n) encoder angles and the speeds differenced from them
    sensors: SensorMemory  #: a row for each robot
    gyros: NDArray[np.float64]  #: (robots, 3) the gyro's present readings
    onboard: NDArray[np.void]  #: records of `ONBOARD_MEMORY`
    kalman: NDArray[np.void]  #: records of `FILTER_MEMORY`
    truths: NDArray[np.float64]  #: (robots, 10) states on the robots' floors
    states: NDArray[np.float64]  #: (robots, 10) that the controllers are given
    filters: NDArray[np.float64]  #: the Kalman filters' work array of each block, a robot a column
    work: NDArray[np.float64]  #: the mechanics' work array of each block
    # scratch
    wheels: NDArray[np.float64]  #: (robots, n) speeds
    rolled: NDArray[np.float64]  #: (robots, n) torques of the rollers
    touching: NDArray[np.float64]  #: (robots, n) angles at which wheels touch the ball [rad]
    rings: NDArray[np.float64]  #: (robots, n) which ring of rollers bears, -1 to 1
    attitude: NDArray[np.float64]  #: (robots, 3) angles that the AHRS shows [rad]
    start: NDArray[np.float64]  #: (robots, 10) states
    force: NDArray[np.float64]  #: (robots, 6) as a row of `pushes`


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


@inlined
def _sensor_memory(memory, robot):
    of = memory.sensors
    return SensorMemory(of.counted[robot], of.errors[robot], of.late[robot])


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
def _let_slip(work, lane, inputs):
    """Give a lane the grip of its contacts, and its weight alone as a load of them."""
    robot = robot_in(work, lane)
    record, numbers = _loop_of(inputs, robot), inputs.parameters[_row_of(inputs.parameters, robot)]
    pressing = inputs.contacts[_row_of(inputs.contacts, robot)]
    work[GRIP * LANES + lane], work[(GRIP + 1) * LANES + lane] = record.wheel_grip, record.floor_grip
    for i in range(len(pressing)):
        work[(PRESSING + i) * LANES + lane] = pressing[i]
    for axis in range(3):
        work[(_GRAVITY + axis) * LANES + lane] = numbers[_GRAVITY + axis]
        work[(_WEIGHT + axis) * LANES + lane] = numbers[_WEIGHT + axis]
        work[(BODY + axis) * LANES + lane] = pressing[0] * numbers[_GRAVITY + axis]


@inlined
def _lean_on(work, lane, push):
    """Let a push act on a lane as a part of its weight, so that what bears it may slip; exact, at any height."""
    for axis in range(3):
        force = push[2 + axis]
        work[(_GRAVITY + axis) * LANES + lane] -= push[5] * force / work[_ML * LANES + lane]
        work[(_WEIGHT + axis) * LANES + lane] -= force
        work[(BODY + axis) * LANES + lane] -= force


@inlined
def _take_pushes(selected, work, lane, inputs, memory, sampling, sample):
    """Let pushes, and the slope of the floor's bumps as a push at the ball's centre, act on a lane for a sample."""
    robot = robot_in(work, lane)
    pushes = inputs.pushes[_row_of(inputs.pushes, robot)]
    bumps = inputs.bumps[_row_of(inputs.bumps, robot)]
    if _loop_of(inputs, robot).wheel_grip > 0.0:
        _let_slip(work, lane, inputs)
    for k in range(len(pushes) + min(len(bumps), 1)):
        push = memory.force[robot]
        if k == len(pushes):
            x, y = memory.truths[robot, 0], memory.truths[robot, 1]
            push[2], push[3] = 0.0, 0.0
            for i in range(len(bumps)):
                size = bumps[i, 3] * math.cos(bumps[i, 0] * x + bumps[i, 1] * y + bumps[i, 2])
                push[2] -= size * bumps[i, 0]
                push[3] -= size * bumps[i, 1]
        else:
            push = pushes[k]
            if not pushes[k, 0] <= sample < pushes[k, 1]:
                continue
        record = _loop_of(inputs, robot)
        if record.wheel_grip > 0.0:
            _lean_on(work, lane, push)
        else:
            _push(selected, work, lane, record, push, sampling.sample_time)


@inlined
def _roll(selected, work, lane, inputs, memory, since):
    """Let a lane's wheels touch the ball where their angles have them; fill `rolled` (n,) with the rollers' torques."""
    n, robot = memory.acting.shape[1], robot_in(work, lane)
    record, rolled, wheels = _loop_of(inputs, robot), memory.rolled[robot], memory.wheels[robot]
    axles = inputs.parameters[_row_of(inputs.parameters, robot)]
    _, speeds = pose(selected, load(selected, work, lane), load_state(selected, work, lane))
    for i in range(n):
        wheels[i] = speeds[i] + work[(SLIP + i) * LANES + lane]
    angles, rings = memory.touching[robot], memory.rings[robot]
    for i in range(n):
        angles[i] = memory.turns[robot, i] + (
            work[(ANGLE + i) * LANES + lane]
            if record.play > 0.0
            else memory.angles[robot, i] + since * memory.speeds[robot, i]
        )
    touch(record, angles, wheels, rolled, rings)
    for i in range(n):
        row = RIGID_SIZE + WHEEL_SIZE * i
        for k in range(3):
            work[(row + k) * LANES + lane] = axles[row + k] + rings[i] * record.off_middle[i, k]


@inlined
def _press(selected, work, lane, inputs, memory):
    """Let the dry friction of a lane's wheels follow the forces between wheels and ball."""
    robot, whole = robot_in(work, lane), load(selected, work, lane)
    record, pressing = _loop_of(inputs, robot), memory.rolled[robot]
    P, u = whole, load_torques(selected, work, lane)
    if record.play > 0.0:
        P, u = wheel_side(whole, record.rotor_inertia), passed_torques(selected, work, lane)
    contacts = inputs.contacts[_row_of(inputs.contacts, robot)]
    _, pressed = wheel_forces(selected, P, load_state(selected, work, lane), u, contacts)
    fill(pressing, pressed)
    numbers = inputs.parameters[_row_of(inputs.parameters, robot)]
    for i in range(len(pressing)):
        share = max(0.0, 1.0 + record.load_dependence * (pressing[i] / record.pressure - 1.0))
        for row in range(RIGID_SIZE + WHEEL_SIZE * i + _DRY, RIGID_SIZE + WHEEL_SIZE * (i + 1)):
            work[row * LANES + lane] = share * numbers[row]


@inlined
def _put_torques(selected, work, width, inputs, memory, h, since):
    """Let the torques act on the lanes for a step of h [s]: behind the motors' lag, and within what the supply leaves.

    The step begins `since` [s] after the sample. Gears with play have the motors' speeds of each step, rigid ones those
    of the sample.
    """
    for lane in range(width):
        robot = robot_in(work, lane)
        record, acting, speeds = _loop_of(inputs, robot), memory.acting[robot], memory.wheels[robot]
        if record.pitch > 0.0:
            _roll(selected, work, lane, inputs, memory, since)
        fill(acting, memory.wanted[robot])
        if record.lag > 0.0:
            kept = math.exp(-h / record.lag)
            mean = (1.0 - kept) * record.lag / h
            for i in range(len(acting)):
                away = memory.given[robot, i] - memory.wanted[robot, i]
                acting[i] += mean * away
                memory.given[robot, i] = memory.wanted[robot, i] + kept * away
        for i in range(len(acting)):
            speeds[i] = work[(MOTOR + i) * LANES + lane] if record.play > 0.0 else memory.speeds[robot, i]
            if record.limited == 1:
                acting[i] = _within_drive(record, acting[i], speeds[i])
        if record.limited == 2:
            _within_supply(record, acting, speeds)
        for i in range(len(acting)):
            load_on_wheel = -memory.rolled[robot, i] if record.pitch > 0.0 else 0.0
            if record.play > 0.0:
                work[(TORQUE + i) * LANES + lane], work[(LOAD + i) * LANES + lane] = acting[i], load_on_wheel
            else:
                work[(TORQUE + i) * LANES + lane] = acting[i] - load_on_wheel


# --- a block ---


@inlined
def _change(selected, work, lane, inputs, memory):
    """Go on with other numbers of the robot in a lane; pose and velocities stay."""
    robot = robot_in(work, lane)
    state = memory.start[robot]
    put_robot(work, lane, inputs.parameters[_row_of(inputs.parameters, robot)])
    fill(state, memory.truths[robot])
    _floored(state, _loop_of(inputs, robot), -1.0)
    start_lane(selected, work, lane, state, work[STEP * LANES + lane])
    work[ROBOT * LANES + lane] = float(robot)


@inlined
def _zero(numbers):
    for i in range(len(numbers)):
        numbers[i] = 0.0


@inlined
def _clear(work, lane, memory):
    """Forget all that the robot in a lane has done."""
    robot = robot_in(work, lane)
    for row in range(ROWS):
        work[row * LANES + lane] = 0.0
    work[ROBOT * LANES + lane] = float(robot)
    for numbers in (memory.laws, memory.wanted, memory.given, memory.commanded, memory.last, memory.angles):
        _zero(numbers[robot])
    _zero(memory.sensors.errors[robot])
    for late in range(len(memory.late)):
        _zero(memory.late[late, robot])


@inlined
def _start(selected, work, lane, inputs, draws, memory):
    """Put a robot into its lane, at rest in its plays."""
    n, robot = memory.acting.shape[1], robot_in(work, lane)
    record, state = _loop_of(inputs, robot), memory.start[robot]
    put_robot(work, lane, inputs.parameters[_row_of(inputs.parameters, robot)])
    fill(state, inputs.initial[_row_of(inputs.initial, robot)])
    onboard_reset(memory.onboard[robot], state)
    reset_filter(memory.kalman[robot], state)
    fill(memory.truths[robot], state)
    _floored(state, record, -1.0)
    start_lane(selected, work, lane, state, 0.0)
    work[ROBOT * LANES + lane] = float(robot)
    _, speeds = pose(selected, load(selected, work, lane), load_state(selected, work, lane))
    work[ROTOR * LANES + lane], work[PLAY * LANES + lane] = record.rotor_inertia, record.play
    for i in range(n):
        memory.turns[robot, i] = draws.turns[robot, i]
        memory.speeds[robot, i] = work[(MOTOR + i) * LANES + lane] = speeds[i]
        if record.play > 0.0:
            memory.starts[robot, i] = record.play * draws.positions[robot, i]
            work[(AHEAD + i) * LANES + lane] = memory.starts[robot, i]


@inlined
def _measure(work, lane, inputs, draws, memory, sample):
    """Read a lane's sensors, and fill its state unless the Kalman filter does."""
    robot = robot_in(work, lane)
    record, state, n = _loop_of(inputs, robot), memory.states[robot], memory.acting.shape[1]
    fill(state, memory.truths[robot])
    gyro, encoders, speeds = memory.gyros[robot], memory.encoders[robot, :n], memory.encoders[robot, n:]
    for i in range(n):
        encoders[i], speeds[i] = memory.angles[robot, i], memory.speeds[robot, i]
        if record.play > 0.0:
            encoders[i] = (
                work[(ANGLE + i) * LANES + lane] + work[(AHEAD + i) * LANES + lane] - memory.starts[robot, i]
            )
            speeds[i] = work[(MOTOR + i) * LANES + lane]
    rate = body_rates(attitude((state[2], state[3], state[4])), (state[7], state[8], state[9]))
    angles, drawn = memory.attitude[robot], sample % draws.samples
    for i in range(3):
        gyro[i], angles[i] = rate[i], state[2 + i]
    if record.estimator == 0:
        return
    noise, faults = draws.noise[robot, (n + 6) * drawn :], draws.faults[robot, 5 * drawn :]
    shown, kept = Shown(encoders, speeds, gyro, angles), _sensor_memory(memory, robot)
    read_sensors(record.sensors, kept, sample, sample * record.sample_time, noise, faults, shown)
    if record.estimator == 1:
        onboard_update(record.onboard, memory.onboard[robot], n, shown, state)
        return
    row, filters = inputs.filters[_row_of(inputs.filters, robot)], memory.filters[robot // LANES]
    show(row, filters, robot % LANES, memory.kalman[robot], record.onboard.ball_from_wheels, shown)


@inlined
def _see(inputs, memory, robot, sample):
    """Fill the state of a robot with a Kalman filter; a missing sample is no number."""
    record, state = _loop_of(inputs, robot), memory.states[robot]
    if record.estimator == 2:
        row, filters = inputs.filters[_row_of(inputs.filters, robot)], memory.filters[robot // LANES]
        see(row, filters, robot % LANES, memory.kalman[robot], state)
    if record.missing_from <= sample < record.missing_until:
        state[0] = np.nan


@inlined
def command(inputs, memory, commands, robot):
    """Decide a robot's torques: those commanded, or its law's and what is commanded beside them."""
    held, commanded = memory.commanded[robot], commands.torques[robot]
    fill(memory.last[robot], held)
    if inputs.law_code == 0:
        fill(held, commanded)
        return
    row, past = inputs.laws[_row_of(inputs.laws, robot)], memory.laws[robot]
    reference = commands.references[_row_of(commands.references, robot)]
    decide_torques(inputs.law_code, row, past, memory.states[robot], reference, held, len(held))
    for i in range(len(commanded)):
        held[i] = min(max(held[i] + commanded[i], -row[LIMIT_AT]), row[LIMIT_AT])
        past[i] = held[i]  # the law's history begins with the torques that act


@inlined
def _drive(inputs, memory, robot, sample, noise, changes):
    """Give motors the torques that are due, with noise (n,), within the driver's limit."""
    record, held, late = _loop_of(inputs, robot), memory.commanded[robot], memory.late
    fill(late[sample % len(late), robot], held)
    due = late[(sample - record.delay) % len(late), robot]
    for i in range(len(held)):
        if sample > 0:
            changes[robot] += (held[i] - memory.last[robot, i]) ** 2
        torque = due[i]
        if record.torque_noise > 0.0:
            torque += record.torque_noise * noise[i]
        if record.limited > 0:
            torque = min(max(torque, -record.torque_limit), record.torque_limit)
        memory.wanted[robot, i] = torque
        if record.lag == 0.0:
            memory.given[robot, i] = torque


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
        stored(work, SPEEDS, lane, add(speeds, restored(selected.wheels, work, SLIP, lane)))


@traced
def _ends_with_play(selected, work, width):
    _ends(selected, work, width, True)


@traced
def _ends_without_play(selected, work, width):
    _ends(selected, work, width, False)


@inlined
def _turn_motors(selected, work, width, plays, memory, steps):
    """Look at the lanes at a sample's end; leave the speeds of rigid motors, and turn their encoders by the mean."""
    if plays:
        _ends_with_play(selected, work, width)
        return
    _ends_without_play(selected, work, width)
    for lane in range(width):
        robot, duration = robot_in(work, lane), steps * work[STEP * LANES + lane]
        for i in range(memory.speeds.shape[1]):
            speed = work[(SPEEDS + i) * LANES + lane]
            memory.angles[robot, i] += 0.5 * duration * (memory.speeds[robot, i] + speed)
            memory.speeds[robot, i] = speed


@inlined
def _end_where_due(selected, work, lane, inputs, sampling, memory, out, sample):
    """Stop a lane that has fallen within the sample, would lift off or slip at its end, or is lost."""
    robot = robot_in(work, lane)
    record = _loop_of(inputs, robot)
    lean = max(abs(work[(STATE + 2) * LANES + lane]), abs(work[(STATE + 3) * LANES + lane]))
    truth = memory.truths[robot]
    _truth(work, lane, record, truth)
    fallen = work[STEP * LANES + lane] == 0.0 or not lean <= LARGEST_LEAN
    # 1 - (theta^2 + phi^2)/2 is at most the product of the cosines
    near = 1.0 - 0.5 * (truth[2] * truth[2] + truth[3] * truth[3]) < record.fallen_cosine
    fallen = fallen or (near and math.cos(truth[2]) * math.cos(truth[3]) < record.fallen_cosine)
    lost = truth[2] * truth[2] + truth[3] * truth[3] > sampling.lost_lean * sampling.lost_lean
    fallen = fallen or (lost and truth[2] * truth[7] + truth[3] * truth[8] > 0.0)
    if not fallen:
        bears = work[_SINKING * LANES + lane] < inputs.lift_offs[_row_of(inputs.lift_offs, robot)]
        if record.wheel_grip > 0.0:
            bears = work[FLOOR * LANES + lane] > 0.0
        if not bears:
            fallen = out.lifted[robot] = True
        elif sampling.grip < math.inf:
            P, u = load(selected, work, lane), load_torques(selected, work, lane)
            if record.play > 0.0:
                P, u = wheel_side(P, record.rotor_inertia), passed_torques(selected, work, lane)
            state = load_state(selected, work, lane)
            touching = inputs.contacts[_row_of(inputs.contacts, robot)]
            if not friction_needed(selected, P, state, u, touching) <= sampling.grip:
                fallen = out.slipped[robot] = True
    if fallen:
        out.ended[robot] = sample
        work[STEP * LANES + lane] = 0.0  # the lane stays where it is


def new_memory(loops: NDArray[np.void], robots: int, n: int, *, filtering: bool) -> LoopMemory:
    """Return the memory of robots that all begin; n is the number of wheels."""
    blocks = -(-robots // LANES)
    delay, latency, window = (
        int(one.max()) for one in (loops["delay"], loops["sensors"]["latency"], loops["sensors"]["window"])
    )
    by_steps = bool(((loops["lag"] > 0.0) | (loops["pitch"] > 0.0)).any())
    shapes = dict.fromkeys(LoopMemory._fields, (robots, n)) | {
        "laws": (robots, MEMORY_SIZE),
        "late": (1 + delay, robots, n),
        "encoders": (robots, 2 * n),
        "gyros": (robots, 3),
        "truths": (robots, 10),
        "states": (robots, 10),
        "attitude": (robots, 3),
        "start": (robots, 10),
        "force": (robots, 6),
    }
    arrays = {name: np.zeros(shape) for name, shape in shapes.items()}
    new = new_work.py_func  # pyright: ignore[reportFunctionMemberAccess] (Numba's)
    work, filters = (
        new(blocks * rows).reshape(blocks, -1) for rows in (ROWS, FILTER_ROWS if filtering else 1)
    )
    for robot in range(robots):
        work[robot // LANES, ROBOT * LANES + robot % LANES] = robot
    others = {
        "by_steps": by_steps,
        "sensors": new_sensor_memory(robots, wheels=n, window=window, latency=latency),
        "onboard": np.zeros(robots, ONBOARD_MEMORY_TYPE),
        "kalman": np.zeros(robots, FILTER_MEMORY_TYPE),
        "work": work,
        "filters": filters,
    }
    return LoopMemory(**arrays | others)  # pyright: ignore[reportArgumentType]


@inlined
def _move(selected, work, width, plays, inputs, memory, sampling):
    """Move a block's robots on by a sample."""
    h = sampling.sample_time / sampling.steps
    for lane in range(width):
        if _loop_of(inputs, robot_in(work, lane)).load_dependence > 0.0:
            _press(selected, work, lane, inputs, memory)
    if not (plays or memory.by_steps):
        _put_torques(selected, work, width, inputs, memory, h, 0.0)
        take_steps(inputs.code, work, width, sampling.steps)
        return
    for step in range(sampling.steps):
        _put_torques(selected, work, width, inputs, memory, h, step * h)
        if plays:
            play_block(inputs.play_code, work, width)
        else:
            take_steps(inputs.code, work, width, 1)


#: what is done with a robot: nothing, a sample on, a start, or a sample on with other numbers
LEFT, ADVANCED, STARTED, CHANGED = range(4)


class Commands(NamedTuple):
    """What is done with robots, a row for each."""

    todo: NDArray[np.int64]  #: `LEFT`, `ADVANCED`, `STARTED` or `CHANGED`
    ages: NDArray[np.int64]  #: samples since each robot's start, which the loop counts
    #: (robots, n) commanded from outside, beside those of the laws, if there are any; else without columns
    torques: NDArray[np.float64]
    references: NDArray[np.float64]  #: (1 or robots, 10) for the laws


@spliced
def advance_block(selected, inputs, draws, sampling, memory, commands, out, begin, width):
    """Do what is to be done with robots begin .. begin + width - 1; what each then sees is in the memory.

    A block begins at a multiple of `LANES`. While others advance, only robots that ended may be `LEFT`.
    """
    n, moving, filtering = memory.acting.shape[1], 0, len(inputs.filters) > 0
    work, plays = memory.work[begin // LANES], _loop_of(inputs, begin).play > 0.0  # all robots, or none
    for lane in range(width):
        robot = robot_in(work, lane)
        if commands.todo[robot] == CHANGED:
            _change(selected, work, lane, inputs, memory)
            commands.todo[robot] = ADVANCED
        if commands.todo[robot] != ADVANCED:
            work[STEP * LANES + lane] = 0.0  # the lane stays where it is
            continue
        moving += 1
        age, drawn = commands.ages[robot], commands.ages[robot] % draws.samples
        command(inputs, memory, commands, robot)
        noise = draws.noise[robot, (n + 6) * drawn + 6 : (n + 6) * drawn + 6 + n]
        _drive(inputs, memory, robot, age, noise, out.changes)
        h = draws.durations[robot, drawn] if draws.durations.shape[1] > 0 else sampling.sample_time
        work[STEP * LANES + lane] = h / sampling.steps
        _take_pushes(selected, work, lane, inputs, memory, sampling, age)
    if moving > 0:
        _move(selected, work, width, plays, inputs, memory, sampling)
        _turn_motors(selected, work, width, plays, memory, sampling.steps)
    for lane in range(width):
        robot = robot_in(work, lane)
        if commands.todo[robot] == LEFT:
            continue
        if commands.todo[robot] == STARTED:
            commands.ages[robot] = 0
            _clear(work, lane, memory)
            _start(selected, work, lane, inputs, draws, memory)
        else:
            commands.ages[robot] += 1
            _end_where_due(selected, work, lane, inputs, sampling, memory, out, commands.ages[robot])
        _measure(work, lane, inputs, draws, memory, commands.ages[robot])
    if filtering and moving > 0:
        sample_block(inputs.filter_code, memory.filters[begin // LANES], width)
    for robot in range(begin, begin + width):
        if commands.todo[robot] != LEFT:
            _see(inputs, memory, robot, commands.ages[robot])


@compiled
def run_block(selected, inputs, draws, sampling, memory, commands, out, span):
    """Start a block of robots, if they are `STARTED`, and take them from a sample to another, each until it ends.

    What is recorded of a robot that has ended is what stood at its end.
    """
    inputs, draws, sampling = borrowed(inputs), borrowed(draws), borrowed(sampling)
    memory, commands, out = borrowed(memory), borrowed(commands), borrowed(out)
    width, starts = len(commands.todo), 1 if commands.todo[0] == STARTED else 0
    for sample in range(span[0] - starts, span[1]):  # a start takes a turn of its own
        record, recorded = sample // sampling.every, sample >= span[0] and sample % sampling.every == 0
        fill(commands.references[0], sampling.references[max(sample, 0)])
        for robot in range(width if recorded else 0):
            fill(out.states[robot, record], memory.truths[robot])
            fill(out.seen[robot, record], memory.states[robot])
            fill(out.encoders[robot, record], memory.encoders[robot])
            fill(out.gyro[robot, record], memory.gyros[robot])
        advance_block(selected, inputs, draws, sampling, memory, commands, out, 0, width)
        for robot in range(width):
            if recorded:
                fill(out.torques[robot, record], memory.acting[robot])
                fill(out.commanded[robot, record], memory.commanded[robot])
            commands.todo[robot] = ADVANCED if out.ended[robot] > commands.ages[robot] else LEFT
    for robot in range(width):
        fill(out.finals[robot], memory.truths[robot])

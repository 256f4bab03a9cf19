"""The compiled loops of `ballbot.simulation.driveline`: one lane under any law, a block of lanes under the classical.

The classical law is the one that identification runs by the thousand. Its lanes are stepped side by side with the
signs of their start, in a loop that becomes vector instructions; a lane that rests, or whose speed would pass zero,
takes the law's own step instead.
"""

import numpy as np

from ballbot.mechanics.compiled import compiled, inlined
from ballbot.mechanics.friction import sign
from ballbot.mechanics.friction_laws.classical import ClassicalNumbers
from ballbot.mechanics.friction_laws.inertia import Inertia, clamped
from ballbot.mechanics.friction_laws.interface import move, visible_speed
from ballbot.mechanics.friction_laws.sliding import slide
from ballbot.mechanics.lanes import LANES, entry

# Rows of a block: five numbers of the law, four of the inertia, then
_SPEED, _ANGLE, _TORQUE, _END, _TRAVEL, _KEPT = 9, 10, 11, 12, 13, 14
_ROWS = 15

_VECTOR = 8  # lanes are filled up to whole vectors, so that a lane rounds alike in every company


@compiled
def run_lane(law, inertia, state, speed, torques, sample_time, steps, every, out):
    """Turn one driveline; `out` (3, records) takes visible speed, angle and integrated speed.

    Parameters
    ----------
    law, inertia : named tuple
    state : ndarray (m,)
        The law's; it is changed.
    speed : float
        At the start [rad/s].
    torques : ndarray (samples,)
    sample_time : float
    steps : int
        Inner steps a sample.
    every : int
    out : ndarray (3, samples // every)
    """
    h, angle = sample_time / steps, 0.0
    for sample in range(len(torques)):
        for _ in range(steps):
            speed, travel = move(law, inertia, torques[sample], state, speed, h)
            angle += travel
        if (sample + 1) % every == 0:
            record = (sample + 1) // every - 1
            out[0, record] = clamped(inertia, visible_speed(law, speed))
            out[1, record] = angle
            out[2, record] = speed


@inlined
def _law(work, lane):
    return ClassicalNumbers(
        entry(work, 0, lane),
        entry(work, 1, lane),
        entry(work, 2, lane),
        entry(work, 3, lane),
        entry(work, 4, lane),
    )


@inlined
def _inertia(work, lane):
    return Inertia(entry(work, 5, lane), entry(work, 6, lane), entry(work, 7, lane), entry(work, 8, lane))


@inlined
def _try_sliding(work, filled, h):
    """Step every lane with the sign of its start, and note whether the speed has kept it."""
    for lane in range(filled):
        speed = entry(work, _SPEED, lane)
        direction = sign(speed)
        torque = entry(work, _TORQUE, lane)
        end, travel = slide(_law(work, lane), _inertia(work, lane), torque, speed, direction, h)
        work[_END * LANES + lane] = end
        work[_TRAVEL * LANES + lane] = travel
        work[_KEPT * LANES + lane] = direction * end


@inlined
def _take_step(work, state, width, filled, h):
    _try_sliding(work, filled, h)
    for lane in range(width):
        if not entry(work, _KEPT, lane) > 0.0:
            speed, torque = entry(work, _SPEED, lane), entry(work, _TORQUE, lane)
            end, travel = move(_law(work, lane), _inertia(work, lane), torque, state, speed, h)
            work[_END * LANES + lane] = end
            work[_TRAVEL * LANES + lane] = travel
    for lane in range(width):
        work[_SPEED * LANES + lane] = entry(work, _END, lane)
        work[_ANGLE * LANES + lane] += entry(work, _TRAVEL, lane)


@compiled
def run_classical_block(laws, inertias, speeds, torques, torque_of, sample_time, steps, every, out):
    """Turn up to `LANES` drivelines under the classical law side by side.

    Parameters
    ----------
    laws, inertias : ndarray (width, 5), (width, 4)
        Rows of `ClassicalNumbers` and `Inertia`.
    speeds : ndarray (width,)
        At the start [rad/s].
    torques : ndarray (inputs, samples)
    torque_of : ndarray (width,)
        Row of torques of each lane.
    sample_time : float
    steps : int
    every : int
    out : ndarray (3, width, samples // every)
        Visible speed, angle and integrated speed.
    """
    width, h = len(laws), sample_time / steps
    filled = (width + _VECTOR - 1) // _VECTOR * _VECTOR
    work = np.zeros(_ROWS * LANES)
    state = np.empty(0)
    for lane in range(width):
        for i in range(5):
            work[i * LANES + lane] = laws[lane, i]
        for i in range(4):
            work[(5 + i) * LANES + lane] = inertias[lane, i]
        work[_SPEED * LANES + lane] = speeds[lane]
    for sample in range(torques.shape[1]):
        for lane in range(width):
            work[_TORQUE * LANES + lane] = torques[torque_of[lane], sample]
        for _ in range(steps):
            _take_step(work, state, width, filled, h)
        if (sample + 1) % every == 0:
            record = (sample + 1) // every - 1
            for lane in range(width):
                out[0, lane, record] = clamped(_inertia(work, lane), entry(work, _SPEED, lane))
                out[1, lane, record] = entry(work, _ANGLE, lane)
                out[2, lane, record] = entry(work, _SPEED, lane)

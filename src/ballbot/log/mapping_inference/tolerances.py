"""What an unknown delay or turn would change in the log, and the confidence that it changes little.

None of them is ever known exactly. A delay that is off by e turns a signal's phase by w e, with w the root mean square
of the signal's rate over that of its value: harmless in a slow log, ruin in a quick one. So the confidence in a
quantity is that its error stays within what a log can bear, from a standard error with these parts:

- the jackknife over blocks of a second, which is all that one log shows;
- for commands that chatter, the time between two rows;
- what the estimates were off on the development halves of `campaigns/mapping_corpus.py` beyond that.

Wheels and lean alone do not show the lean's delay. Play in the gears makes the ball, and with it the lean, later than
the encoders by the time in which a motor crosses the gap, and motors that respond to noise of roll and pitch make the
lean seem late, too. Undone as estimated, less what play takes, it was off by 11 ms (root mean square) on 283 logs of
the development halves, and left at zero by 7 ms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.evidence import CONFIDENT, MOST
from ballbot.log.mapping_inference.file_signals import GyroTest, Signals
from ballbot.log.mapping_inference.placement import LAGS, LeanTest
from ballbot.log.mapping_inference.wheel_response import CommandTest
from ballbot.log.signals import Smooth, smooth

#: phase [rad] that the lean may be off by a delay: its part along the true lean is then cos 0.3 = 0.955 of it
LEAN_PHASE = 0.3
#: the same of the torques: their root mean square error is then 0.2 of their size
TORQUE_PHASE = 0.2
#: turn of the IMU that may be off [rad]: a fifth of a lean appears in the other axis
TURN = math.radians(12.0)
#: part of the torques, by size, that an unknown dead band may change
TORQUE_PART = 0.2
#: how late a lean in time may seem [s]: of 283 logs of the development halves, with play of a degree, the lag less the
#: true delay is 13 ms in the mean, its standard deviation 16 ms, and 43 ms or less in 95 %
LAG_OF_PLAY = 0.04
#: error of the command's delay beyond the jackknife [s]: root mean square on the development halves
COMMAND_ERROR = 0.004
#: error of a turn over the logarithm of the gain [rad]. Of 33 logs of the development halves whose gain is off by more
#: than a tenth, the root mean square is 0.095
TURN_PER_GAIN = 0.15
#: the turn's error over its jackknife: of 176 logs of the development halves, the turn of 2 is off by more than `TURN`
#: with a confidence above 0.9 at 1.5, and of none at 1.8
TURN_JACKKNIFE = 1.8
#: share of the wheels' accelerations that the commands must explain for their delay to be known: 100 stretches of the
#: development halves that explain less find it 16 ms too late, in the mean
EXPLAINED_FOR_DELAY = 0.75
#: probability before the log is seen that a delay is undone already, or too small to matter; chosen
NO_DELAY = 0.3
#: a delay is undone as estimated if it is at least so many of its standard errors. At one, delays of 11 to 18 ms were
#: undone that were none; at two, the public course robot's 8 ms, at 1.6 errors, are asked for, although zero is the
#: worse guess
APPLIED = 1.5
#: and from so many on as expected: the mean of the delays that remain likely, of which zero is one
LIKELY = 1.0
#: an estimate this many standard errors below zero is rejected: a delay cannot be negative
EARLY = 2.0
#: delays that are not seen lie between zero and these [s]: an IMU's filter takes up to 20 ms, a driver up to 15
LONGEST_LEAN_DELAY, LONGEST_COMMAND_DELAY = 0.02, 0.015
#: wheel speeds that a file has without angles are late by a filter of up to this [s]
LONGEST_SPEED_DELAY = 0.02
#: root mean square of a gyro's own delay [s], by its filter: chosen
GYRO_DELAY = 0.004
#: a delay of the commands that no robot that balances has [s]: it comes from something else
IMPOSSIBLE_COMMAND_DELAY = 0.025
#: filter of the commands before their quickness is taken [s]
COMMAND_FILTER = 0.05
#: factor of `missed_between_rows` [1/sqrt(s)], measured: 0.44 to 0.56 on the five logs of the second development half
#: where it matters
MISSED = 0.49
#: rows miss samples of the controller if they are this many times as far apart
SLOWER = 1.2
#: a delay counts as right if its error is no larger than this [s], a row of most logs
RIGHT_DELAY = 0.005


@dataclass(frozen=True, kw_only=True)
class Delay:
    """A delay as it is undone, and what is known of it."""

    applied: float  #: [s]; zero if it cannot be told from zero
    error: float  #: standard error of the applied one [s]
    quickness: float  #: w of the delayed signal [rad/s]
    harmless: float  #: probability that the error is harmless
    evidence: str  #: one sentence
    measured: bool = False  #: whether the log shows the delay, be it zero

    @property
    def confidence(self) -> float:
        """The probability that the delay is right to `RIGHT_DELAY`."""
        return harmless(self.error, RIGHT_DELAY)


#: end of an answer that the log does not show
ASSUMED = ", assumed"


def delay_words(late: Delay) -> str:
    """Return a delay as it is undone."""
    return f"{1e3 * late.applied:.1f} ms{'' if late.measured else ASSUMED}"


def delay_evidence(late: Delay, bearable: float) -> str:
    """Return a delay's evidence, with whether an error changes the log by more than it can bear."""
    return f"{late.evidence}, {'harmless' if bearable >= CONFIDENT else 'which matters'} in this log"


def harmless(error: float, tolerance: float) -> float:
    """Return the probability that a normal error of this standard deviation stays within a tolerance."""
    if not math.isfinite(error):
        return 0.5
    return min(math.erf(tolerance / (math.sqrt(2.0) * max(error, 1e-9))), MOST)


def quickness(signal: Smooth, usable: NDArray[np.bool_]) -> float:
    """Return the root mean square of a signal's rate over that of its value, both less their means [rad/s]."""
    if not usable.any():
        return 0.0
    value, rate = signal.value[usable], signal.rate[usable]
    size = float(np.sqrt(value.var(axis=0).sum()))
    return float(np.sqrt(rate.var(axis=0).sum())) / size if size > 0.0 else 0.0


def lean_delay(
    tested: LeanTest,
    signals: Signals,
    gyro: GyroTest | None,
    *,
    interval: float,
    early: float = 0.0,
    early_error: float = 0.0,
    of_speeds: bool = False,
) -> Delay:
    """Return the lean's delay: what it is later than a gyro, or than commands that respond to its noise.

    The lag at which the wheels explain the lean best does not measure it (see the module's text).

    Parameters
    ----------
    tested : LeanTest
    signals : Signals
    gyro : GyroTest, optional
    interval : float
        Between the file's rows [s].
    early : float
        By how much commands, later by their own delay, respond to the lean's noise before it is in the log [s]; it
        counts from a row's length on.
    early_error : float
        Standard error of the commands' own delay [s].
    of_speeds : bool
        Whether the wheels' angles are integrals of logged speeds, which may be late, too.
    """
    if signals.lean is None:
        return Delay(applied=0.0, error=math.inf, quickness=0.0, harmless=0.5, evidence="there is no lean")
    unseen = _unseen(LONGEST_LEAN_DELAY)
    applied, error = 0.0, unseen
    evidence = (
        f"the wheels explain the lean best {1e3 * tested.lag:.1f} ms earlier, as they do up to "
        f"{1e3 * LAG_OF_PLAY:.0f} ms without a delay, by play and noise"
    )
    said = f"the log does not measure it: up to {1e3 * LONGEST_LEAN_DELAY:.0f} ms must be expected"
    if early >= interval:
        applied, error = early, min(math.hypot(early_error, interval), unseen)
        said = f"less their own delay, the commands respond to its noise {1e3 * early:.0f} ms before it is in the log"
    elif gyro is not None and gyro.lag > 0.0:
        applied, error = gyro.lag, min(math.hypot(gyro.lag_error, GYRO_DELAY), unseen)
        said = f"roll and pitch are {1e3 * applied:.1f} ms later than the gyro, which is taken to be in time"
    if of_speeds:
        # a lean earlier than the wheels shows it; one that is later may be as late by play
        late = _unseen(LONGEST_SPEED_DELAY) if tested.lag > LAGS[0] else 1.5 * LONGEST_SPEED_DELAY
        error = math.hypot(error, late)
        said += f"; the wheels' speeds may be late, too, by up to {1e3 * LONGEST_SPEED_DELAY:.0f} ms of their filter"
    quick = quickness(signals.lean, tested.balancing)
    return Delay(
        applied=round(applied, 4),
        error=error,
        quickness=quick,
        harmless=harmless(error * quick, LEAN_PHASE),
        evidence=f"{evidence}; {said}; {_effect(error, quick)}",
        measured=applied > 0.0,
    )


def _unseen(longest: float) -> float:
    """Return the root mean square of a delay of up to the longest, before the log is seen [s]."""
    return longest * math.sqrt((1.0 - NO_DELAY) / 3.0)


def _effect(error: float, quick: float) -> str:
    return f"an error of {1e3 * error:.0f} ms is {error * quick:.2f} rad of its motion"


def command_delay(
    tested: CommandTest | None,
    signals: Signals,
    usable: NDArray[np.bool_],
    *,
    interval: float,
    early: float = 0.0,
) -> Delay:
    """Return the delay from a command to the motor.

    Parameters
    ----------
    tested : CommandTest, optional
    signals : Signals
    usable : ndarray (N,)
        Rows that count.
    interval : float
        Between the file's rows [s].
    early : float
        By how much the commands respond to the lean's noise before it is in the log [s]; it counts from a row's length
        on. If their delay is not measured otherwise, it is one half, and the lean's the other.
    """
    if signals.commands is None:
        return Delay(applied=0.0, error=0.0, quickness=0.0, harmless=0.5, evidence="there are no commands")
    calm = smooth(signals.rows, signals.rows, signals.commands, width=COMMAND_FILTER)
    quick = quickness(calm, usable)
    evidence, estimate, error = "commands and quick accelerations of the wheels differ", 0.0, math.inf
    if tested is not None:
        evidence = (
            f"at {1e3 * tested.delay:.1f} ms the commands explain {100 * tested.explained:.0f} % of the wheels' "
            "accelerations"
        )
        error = COMMAND_ERROR / tested.explained
        if tested.explained < EXPLAINED_FOR_DELAY:
            # friction that sticks makes wheels that the commands explain little seem late
            error = math.inf
            evidence += f", too few ({100 * EXPLAINED_FOR_DELAY:.0f} %) to believe it"
        # commands that chatter are not known between two rows, and an alias of theirs fits best one or two rows off
        aliased = 2.0 * interval * _chatter(signals.commands, calm, usable)
        error = math.hypot(tested.delay_error, error, aliased)
        estimate = tested.delay
    found = _delay(estimate, error, quick, evidence=evidence)
    if found.measured or early < interval:
        return found
    # either delay may be all of it
    applied, error = min(0.5 * early, LONGEST_COMMAND_DELAY), math.hypot(0.5 * early, interval)
    evidence += (
        f"; they respond to the lean's noise {1e3 * early:.0f} ms before it is in the log: half of that is taken for "
        "their delay, and half for the lean's"
    )
    return replace(
        found,
        applied=round(applied, 4),
        error=error,
        harmless=harmless(error * quick, TORQUE_PHASE),
        evidence=f"{evidence}; {_effect(error, quick)}",
    )


def missed_between_rows(
    signals: Signals, usable: NDArray[np.bool_], braked: float, *, interval: float, sample_time: float
) -> float:
    """Return the size of the torques that the rows miss, over that of all torques.

    A controller commands anew every sample. Of commands that chatter, rows farther apart have a random part, and what
    the back-EMF leaves of duties is small beside it.

    Parameters
    ----------
    signals : Signals
    usable : ndarray (N,)
        Rows that count.
    braked : float
        As `DriveEvidence` has it.
    interval, sample_time : float
        Between the file's rows, and of the controller [s].
    """
    if signals.commands is None or not math.isfinite(braked) or interval < SLOWER * sample_time:
        return 0.0
    calm = smooth(signals.rows, signals.rows, signals.commands, width=COMMAND_FILTER)
    return MISSED * braked * math.sqrt(_chatter(signals.commands, calm, usable) * interval)


def _chatter(commands: NDArray[np.float64], calm: Smooth, usable: NDArray[np.bool_]) -> float:
    """Return the share of the commands' power that a filter of `COMMAND_FILTER` removes."""
    power = float(commands[usable].var(axis=0).sum())
    left = float(calm.value[usable].var(axis=0).sum())
    return max(1.0 - left / power, 0.0) if power > 0.0 else 0.0


def _delay(estimate: float, error: float, quick: float, *, evidence: str) -> Delay:
    """Return the commands' delay to undo, if it is clearly none of zero; one that is not seen is of the usual ones."""
    longest, unseen = LONGEST_COMMAND_DELAY, _unseen(LONGEST_COMMAND_DELAY)
    # an estimate is of use only if its error is below the deviation of usual delays
    known = error < longest / math.sqrt(3.0) and -EARLY * error < estimate < IMPOSSIBLE_COMMAND_DELAY
    said = f"standard error of the estimate {1e3 * error:.1f} ms"
    if known and estimate > APPLIED * error:
        applied = round(estimate, 4)
    elif known and estimate > LIKELY * error:
        expected, error = _expected_delay(estimate, error, longest)
        applied = round(expected, 4)
        said += (
            ", no clear difference from zero, so that the expected value among usual delays, up to "
            f"{1e3 * longest:.0f} ms, is undone"
        )
    elif known:
        applied, error = 0.0, min(math.hypot(estimate, error), unseen)
        said += ", so that it is no clear difference from zero and not undone"
    else:
        applied, error = 0.0, unseen
        said = f"the log does not measure it: up to {1e3 * longest:.0f} ms must be expected"
    return Delay(
        applied=applied,
        error=error,
        quickness=quick,
        harmless=harmless(error * quick, TORQUE_PHASE),
        evidence=f"{evidence}; {said}; {_effect(error, quick)}",
        measured=known,
    )


def _expected_delay(estimate: float, error: float, longest: float) -> tuple[float, float]:
    """Return the mean and standard deviation of a delay [s], given a normal estimate.

    Before the log is seen it is zero with the probability `NO_DELAY`, else of any size up to the longest alike.
    """
    delays = np.linspace(0.0, longest, 200)
    prior = np.full(200, (1.0 - NO_DELAY) / 200.0)
    prior[0] += NO_DELAY
    weights = prior * np.exp(-0.5 * np.square((delays - estimate) / error))
    weights /= weights.sum()
    mean = float(weights @ delays)
    return mean, math.sqrt(float(weights @ np.square(delays - mean)))


def command_delay_harmless(late: Delay, braked: float) -> float:
    """Return the probability that the commands' delay is harmless; `braked` is as `DriveEvidence` has it."""
    if not math.isfinite(braked):
        return 0.5
    return harmless(late.error * late.quickness * max(braked, 1.0), TORQUE_PHASE)


def turn_confidence(tested: LeanTest) -> float:
    """Return the confidence in the IMU's turn: a gain that is not the robot's is a sign of another error, too."""
    if tested.phase_error is None:
        return 0.5
    own = TURN_PER_GAIN * abs(math.log(max(tested.placements[0].gain, 1e-3)))
    return harmless(math.hypot(TURN_JACKKNIFE * tested.phase_error, own), TURN)

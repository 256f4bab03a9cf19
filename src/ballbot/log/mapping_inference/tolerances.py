"""What an unknown delay or turn would change in the log, and the confidence that it changes little.

None of them is ever known exactly. A delay that is off by e turns a signal's phase by w e, with w the root mean square
of the signal's rate over that of its value: harmless in a slow log, ruin in a quick one. So the confidence in a
quantity is that its error stays within what a log can bear, from a standard error with these parts:

- the jackknife over blocks of a second, which is all that one log shows;
- play in the gears, which makes the ball, and with it the lean, later than the encoders by about 0.45 b over the
  wheels' speed (root mean square) for a play b: the first harmonic of a sine wave that loses b/2 at every turning
  point. It looks like a delay of the lean, and no log of encoders and lean separates the two;
- for commands that chatter, the time between two rows;
- what the estimates were off on the development halves of `campaigns/mapping_corpus.py` beyond that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.evidence import CONFIDENT, MOST
from ballbot.log.mapping_inference.file_signals import Signals
from ballbot.log.mapping_inference.placement import LeanTest
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
#: play of a wheel's gear that must be expected [rad]: one degree is usual, and two of small gear motors
PLAY = math.radians(1.5)
#: play's delay is PLAY_DELAY b / (speed, root mean square): 4 / pi (b / 2) / amplitude is the phase, sqrt(2) the peak
PLAY_DELAY = 2.0 / math.pi / math.sqrt(2.0)
#: error of the lean's delay beyond jackknife and play, and of the command's [s]: root mean squares on the development
#: halves
LEAN_ERROR, COMMAND_ERROR = 0.006, 0.004
#: phase of the lean over the mean rate of a heading that keeps turning [s]: three twins that spin at 0.56 rad/s seem
#: 28 to 31 ms late, which is 0.03 to 0.05 rad of their slow lean, and are not
SPIN_PHASE = 0.07
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
#: delays that no robot that balances has [s]: they come from something else
IMPOSSIBLE_LEAN_DELAY, IMPOSSIBLE_COMMAND_DELAY = 0.045, 0.025
#: standard errors by which a delay may be longer than the commands' response to the lean allows
LATE = 2.5
#: filter of the commands before their quickness is taken [s]
COMMAND_FILTER = 0.05


@dataclass(frozen=True, kw_only=True)
class Delay:
    """A delay as it is undone, and what is known of it."""

    applied: float  #: [s]; zero if it cannot be told from zero
    error: float  #: standard error of the applied one [s]
    quickness: float  #: w of the delayed signal [rad/s]
    confidence: float  #: that the error is harmless
    evidence: str  #: one sentence
    measured: bool = False  #: whether the log shows the delay, be it zero


def delay_words(late: Delay) -> str:
    """Return a delay as it is undone."""
    return f"{1e3 * late.applied:.1f} ms{'' if late.measured else ', assumed'}"


def delay_evidence(late: Delay, confidence: float) -> str:
    """Return a delay's evidence; the confidence is that its error is harmless, and may be high of one not measured."""
    if late.measured:
        return late.evidence
    return f"{late.evidence}, {'harmless' if confidence >= CONFIDENT else 'which matters'} in this log"


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


def lean_delay(tested: LeanTest, signals: Signals, *, latest: float = math.inf) -> Delay:
    """Return the lean's delay after the wheels; `latest` is the longest with which the commands respond in time [s]."""
    if signals.lean is None:
        return Delay(applied=0.0, error=math.inf, quickness=0.0, confidence=0.5, evidence="there is no lean")
    usable = tested.balancing
    speed = float(np.sqrt(np.mean(np.square(signals.wheels.rate[usable]))))
    play = PLAY_DELAY * PLAY / max(speed, 1e-3)
    # what play takes lies between zero and all of it
    estimate = tested.lag - 0.5 * play
    quick = quickness(signals.lean, usable)
    spin = 0.0 if signals.heading is None else abs(float(signals.heading.rate[usable].mean()))
    error = math.hypot(tested.lag_error, 0.3 * play, LEAN_ERROR, SPIN_PHASE * spin / max(quick, 1e-3))
    evidence = (
        f"the wheels explain the lean best {1e3 * tested.lag:.1f} ms earlier, of which play of "
        f"{math.degrees(PLAY):.1f} deg would take {1e3 * play:.0f} ms"
    )
    clear = estimate > APPLIED * error
    if latest < estimate < latest + LATE * error:
        evidence += f"; by the commands, which respond to the lean's noise, at most {1e3 * latest:.0f} ms"
        estimate = latest
    return _delay(
        estimate,
        error,
        quick,
        clear=clear,
        tolerance=LEAN_PHASE,
        limits=(LONGEST_LEAN_DELAY, IMPOSSIBLE_LEAN_DELAY),
        evidence=evidence,
    )


def command_delay(
    tested: CommandTest | None,
    signals: Signals,
    usable: NDArray[np.bool_],
    *,
    interval: float,
    earliest: float = 0.0,
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
    earliest : float
        The shortest delay with which the commands respond to the lean's noise no earlier than it is there [s]; it
        counts from a row's length on.
    """
    if signals.commands is None:
        return Delay(applied=0.0, error=0.0, quickness=0.0, confidence=0.5, evidence="there are no commands")
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
    if earliest >= interval and not (math.isfinite(error) and estimate >= earliest):
        evidence += f"; they respond to the lean's noise {1e3 * earliest:.0f} ms before it is in the log"
        return Delay(
            applied=round(earliest, 4),
            error=interval,
            quickness=quick,
            confidence=harmless(interval * quick, TORQUE_PHASE),
            evidence=evidence,
            measured=True,
        )
    return _delay(
        estimate,
        error,
        quick,
        clear=estimate > APPLIED * error,
        tolerance=TORQUE_PHASE,
        limits=(LONGEST_COMMAND_DELAY, IMPOSSIBLE_COMMAND_DELAY),
        evidence=evidence,
    )


def _chatter(commands: NDArray[np.float64], calm: Smooth, usable: NDArray[np.bool_]) -> float:
    """Return the share of the commands' power that a filter of `COMMAND_FILTER` removes."""
    power = float(commands[usable].var(axis=0).sum())
    left = float(calm.value[usable].var(axis=0).sum())
    return max(1.0 - left / power, 0.0) if power > 0.0 else 0.0


def _delay(
    estimate: float,
    error: float,
    quick: float,
    *,
    clear: bool,
    tolerance: float,
    limits: tuple[float, float],
    evidence: str,
) -> Delay:
    """Return the delay to undo if it is clearly none of zero; one that is not seen is at most the first limit."""
    longest, impossible = limits
    unseen = longest * math.sqrt((1.0 - NO_DELAY) / 3.0)  # root mean square, before the log is seen
    # an estimate is of use only if its error is below the deviation of usual delays
    known = error < longest / math.sqrt(3.0) and -EARLY * error < estimate < impossible
    said = f"standard error of the estimate {1e3 * error:.1f} ms"
    if known and clear:
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
    confidence = harmless(error * quick, tolerance)
    effect = f"an error of {1e3 * error:.0f} ms is {error * quick:.2f} rad of its motion"
    return Delay(
        applied=applied,
        error=error,
        quickness=quick,
        confidence=confidence,
        evidence=f"{evidence}; {said}; {effect}",
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


def command_delay_confidence(late: Delay, braked: float) -> float:
    """Return the confidence in the commands' delay; `braked` is as `DriveEvidence` has it."""
    if not math.isfinite(braked):
        return 0.5
    return harmless(late.error * late.quickness * max(braked, 1.0), TORQUE_PHASE)


def turn_confidence(tested: LeanTest) -> float:
    """Return the confidence in the IMU's turn: a gain that is not the robot's is a sign of another error, too."""
    if tested.phase_error is None:
        return 0.5
    own = TURN_PER_GAIN * abs(math.log(max(tested.placements[0].gain, 1e-3)))
    return harmless(math.hypot(TURN_JACKKNIFE * tested.phase_error, own), TURN)

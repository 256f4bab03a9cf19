"""What a validation found, in words: where friction helps, where not and why, and what the residuals have in common."""

from __future__ import annotations

import numpy as np

from ballbot.log import STATE_NAMES
from ballbot.validation.dither import Dither
from ballbot.validation.prediction import Prediction
from ballbot.validation.state_errors import ErrorPair
from ballbot.validation.validation import Validation

#: a state's error is put down to the noise of its start from this share on
_NOISE_SHARE = 0.7
#: dither counts as fast from this share of the motion of turning on
_DITHER_SHARE = 0.5
#: residuals are named where they correlate this strongly
_STRONG = 0.5

#: reversals this many times as frequent as the motion's own are chatter
_CHATTER = 5.0

#: pairs of residuals that are to be expected, and why
_ROLLING = "the wheels carry the ball along with the leaning body, and its speed is computed from theirs and the gyro's"
_INTEGRAL = "the on-board position is the integral of the speed, so that it has the speed's error"
_EXPECTED = {
    frozenset({"e_x_dot", "e_phi_dot"}): _ROLLING,
    frozenset({"e_y_dot", "e_theta_dot"}): _ROLLING,
    frozenset({"e_x", "e_phi_dot"}): _ROLLING,
    frozenset({"e_y", "e_theta_dot"}): _ROLLING,
    frozenset({"e_x", "e_x_dot"}): _INTEGRAL,
    frozenset({"e_y", "e_y_dot"}): _INTEGRAL,
}


def findings(validation: Validation) -> tuple[str, ...]:
    """Return the findings as plain sentences, the verdict first."""
    found = [_open_loop_verdict(validation), *weak_states(validation)]
    if validation.closed_loop is not None:
        found.append(_closed_loop_verdict(validation))
    elif validation.no_closed_loop is not None:
        found.append(f"No closed-loop validation: {validation.no_closed_loop}")
    found.append(_horizon_verdict(validation))
    found.extend(_residual_findings(validation.prediction))
    return tuple(found)


def weak_states(validation: Validation) -> tuple[str, ...]:
    """Return a sentence for each state that friction does not surely help in open loop, with the reason found.

    "Surely" is the 95 % bootstrap interval of the ratio of errors lying above one.
    """
    errors = validation.open_loop.errors
    lower, upper = errors.ratio_interval()
    sentences = []
    for index, name in enumerate(STATE_NAMES):
        ratio = errors.ratio[index]
        if ratio > 1.0 and not lower[index] <= 1.0:
            continue
        claim = "does not help" if ratio <= 1.0 else "may not help"
        interval = f", 95 % interval {lower[index]:.2f} to {upper[index]:.2f}" if errors.runs > 1 else ""
        sentences.append(
            f"{name}: friction {claim} in open loop (ratio {ratio:.2f}{interval}). {_reason(validation, index)}"
        )
    return tuple(sentences)


def describe_dither(validation: Validation) -> str | None:
    """Return what the wheels' speeds show of the rollers' dither, or None where the log has no wheel speeds."""
    dither = validation.dither
    if dither is None:
        return None
    v_s = validation.robot.friction.stribeck_speed
    fast, heading, reversals, slow_reversals = (
        float(values.mean())
        for values in (dither.dither, dither.heading, dither.reversals, dither.reversals_of_motion)
    )
    return (
        f"Above {dither.corner:.1f} Hz, faster than the robot can balance, the wheels' speed shakes by {fast:.3f} "
        f"rad/s rms ({dither.encoder:.3f} of it is the encoders' counting), beside {heading:.3f} rad/s that turning "
        f"about the vertical asks of them and a Stribeck speed of {v_s:.2f} rad/s; the wheels reverse "
        f"{reversals:.2f} times a second, {slow_reversals:.2f} times without the shaking."
    )


def _reason(validation: Validation, index: int) -> str:
    """Return the reason that the data show for a state that friction does not help."""
    loop = validation.open_loop
    share = loop.noise_floor[index] / loop.errors.with_friction.rmse[index]
    if share > _NOISE_SHARE:
        return (
            f"Reason: the noise of the measured start alone causes {100 * share:.0f} % of the error, so that this "
            "state cannot tell the two models apart."
        )
    dither = validation.dither
    if dither is not None and _chatters(dither):
        return f"Reason: the wheels chatter. {describe_dither(validation)}"
    if dither is not None and STATE_NAMES[index] in ("psi", "psi_dot") and _dithers(dither):
        return f"Reason: the rollers dither the wheels. {describe_dither(validation)}"
    if loop.errors.ratio[index] > 1.0:
        return f"Reason: {loop.errors.runs} runs are too few to tell; the ratio itself is above one."
    return (
        f"No reason was found in the data: the start's noise causes {100 * share:.0f} % of the error and the wheels' "
        "dither does not explain it, so that the model itself lacks something for this state."
    )


def _dithers(dither: Dither) -> bool:
    real = np.sqrt(np.maximum(dither.dither**2 - dither.encoder**2, 0.0))
    return bool(np.mean(real) > _DITHER_SHARE * np.mean(dither.heading))


def _chatters(dither: Dither) -> bool:
    return bool(np.mean(dither.reversals) > _CHATTER * np.mean(dither.reversals_of_motion))


def _range_of(errors: ErrorPair) -> str:
    """Return in how many states friction lowers the error, and by which factors."""
    ratio = errors.ratio
    better = int(np.count_nonzero(ratio > 1.0))
    weakest, strongest = int(np.argmin(ratio)), int(np.argmax(ratio))
    count = "every one of the ten states" if better == len(ratio) else f"{better} of the ten states"
    return (
        f"the error with friction is below the one without in {count}: {ratio[weakest]:.1f} times "
        f"({STATE_NAMES[weakest]}) to {ratio[strongest]:.1f} times ({STATE_NAMES[strongest]})"
    )


def _open_loop_verdict(validation: Validation) -> str:
    loop = validation.open_loop
    length = float(loop.errors.with_friction.samples.mean()) * validation.sample_time
    return (
        f"Open loop, {loop.errors.runs} runs of {length:.2g} s on average ({100 * loop.past_recovery:.0f} % of them "
        f"ended by a lean past recovery, {np.degrees(loop.recoverable_lean):.0f} degrees): {_range_of(loop.errors)}."
    )


def _closed_loop_verdict(validation: Validation) -> str:
    closed = validation.closed_loop
    assert closed is not None
    restarted = closed.restarted
    runs = f"restarted every {closed.restart_every:.2g} s ({restarted.runs} runs)"
    verdict = f"Closed loop, {runs}: {_range_of(restarted)}."
    behind = [name for name, ratio in zip(STATE_NAMES, closed.whole.ratio, strict=True) if ratio <= 1.0]
    if behind:
        verdict += (
            " Over the whole log without a restart, model and robot lose each other's phase in the limit cycle, and "
            f"friction does not help in {', '.join(behind)}."
        )
    return verdict


def _horizon_verdict(validation: Validation) -> str:
    horizon = validation.horizon
    # over the ten states, the median: one quiet state decides nothing
    ratio = np.median(horizon.ratio, axis=1)
    tells = np.flatnonzero(ratio > 1.2)
    if tells.size == 0:
        return (
            f"Up to {1e3 * horizon.horizons[-1]:.0f} ms ahead, friction makes little difference to the forecast "
            f"(median ratio {ratio[-1]:.2f})."
        )
    return (
        f"One sample ahead the sensors' noise decides (median ratio {ratio[0]:.2f}); friction shows from about "
        f"{1e3 * horizon.horizons[tells[0]]:.0f} ms on and makes the forecast {ratio[-1]:.1f} times better at "
        f"{1e3 * horizon.horizons[-1]:.0f} ms."
    )


def _residual_findings(prediction: Prediction) -> list[str]:
    """Return a sentence on the strong pairs of residuals and torques that are expected, and one on the rest."""
    labels, correlation = prediction.labels, prediction.correlation
    expected: dict[str, list[str]] = {}
    unexpected = []
    for i in range(len(STATE_NAMES)):
        for j in range(i + 1, len(labels)):
            if abs(correlation[i, j]) < _STRONG:
                continue
            pair = f"{labels[i]} with {labels[j]} ({correlation[i, j]:+.2f})"
            reason = _EXPECTED.get(frozenset({labels[i], labels[j]}))
            if reason:
                expected.setdefault(reason, []).append(pair)
            else:
                unexpected.append(pair)
    found = [
        f"Residuals that belong together: {', '.join(pairs)}; {reason}." for reason, pairs in expected.items()
    ]
    if unexpected:
        found.append(
            f"Residuals and torques that should not go together but do: {', '.join(unexpected)}; something is not "
            "modelled."
        )
    else:
        found.append(
            "No other residual correlates with another or with a torque by 0.5 or more: nothing unmodelled stands out."
        )
    return found

"""Everything that the one-step residuals of a model are asked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.derived import encoder_step
from ballbot.validation.prediction import Prediction
from ballbot.validation.residuals.correlation import Correlations, correlations
from ballbot.validation.residuals.peak_names import Clues, NamedPeak, named_peaks
from ballbot.validation.residuals.play_effect import PlayEffect, play_effect
from ballbot.validation.residuals.position_effect import PositionEffect, position_effect
from ballbot.validation.residuals.series import blocks_of, lagged, slices
from ballbot.validation.residuals.spectrum import Spectrum, spectrum
from ballbot.validation.residuals.speed_effect import SpeedEffect, speed_effect
from ballbot.validation.residuals.updates import Updates
from ballbot.validation.residuals.wheel_torque import wheel_torque_residuals
from ballbot.validation.residuals.whiteness import Whiteness, whiteness

#: errors are clustered over this [s]
_BLOCK = 0.25
#: fewer blocks say nothing about the wheels
LEAST_BLOCKS = 80
#: a speed so many rows earlier shares no noise with the residual
_EARLIER = 3
#: a turn back by less than so many encoder steps, and by less than this [rad], is noise
_STEPS, _LEAST_TURN = 3.0, 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualAnalysis:
    """What a model's residuals show; None where the log is too short or lacks a column."""

    correlations: Correlations
    whiteness: Whiteness | None
    spectrum: Spectrum | None
    peaks: tuple[NamedPeak, ...]  #: of the spectrum
    updates: Updates
    by_speed: tuple[SpeedEffect, ...] | None  #: by wheel
    by_travel: PlayEffect | None
    by_position: PositionEffect | None
    roller_passing: (
        NDArray[np.float64] | None
    )  #: (3,) [Hz] of a ring, at 10, 50 and 90 % of the wheels' speeds
    no_wheels: str | None  #: why there is no look at the wheels' speed and travel
    no_position: str | None  #: why there is none at their position


def analyse_residuals(prediction: Prediction, model: Model, updates: Updates) -> ResidualAnalysis:
    """Ask the residuals of a prediction by `model` everything that its log allows."""
    columns = np.hstack([prediction.residuals, prediction.torques])
    no_wheels = _no_wheels(prediction)
    by_speed, by_travel, by_position, no_position = None, None, None, no_wheels
    if no_wheels is None:
        torques = wheel_torque_residuals(prediction, model)
        blocks = _blocks(prediction)
        by_speed, by_travel = _by_motion(prediction, torques, blocks, model.robot)
        by_position, no_position = _by_position(prediction, torques, blocks, model.robot)
    turning = _turning(prediction)
    orders = () if by_position is None else by_position.found
    clues = Clues(updates=updates, turning=turning, rollers=model.robot.wheels.rollers, orders=orders)
    of_all = spectrum(prediction.residuals, prediction.segments, sample_time=prediction.sample_time)
    return ResidualAnalysis(
        correlations=correlations(columns, prediction.labels, prediction.segments),
        whiteness=whiteness(prediction.residuals, prediction.segments),
        spectrum=of_all,
        peaks=named_peaks(of_all, clues) if of_all else (),
        updates=updates,
        by_speed=by_speed,
        by_travel=by_travel,
        by_position=by_position,
        roller_passing=None if turning is None else model.robot.wheels.rollers.per_row * turning,
        no_wheels=no_wheels,
        no_position=no_position,
    )


def _blocks(prediction: Prediction) -> NDArray[np.int64]:
    return blocks_of(prediction.segments, length=max(1, round(_BLOCK / prediction.sample_time)))


def _no_wheels(prediction: Prediction) -> str | None:
    if prediction.wheel_angles is None or prediction.wheel_speeds is None:
        return "the log lacks the encoder angles or speeds"
    seconds = len(prediction.residuals) * prediction.sample_time
    if seconds < LEAST_BLOCKS * _BLOCK:
        return f"{seconds:.1f} s are too short; at least {LEAST_BLOCKS * _BLOCK:.0f} s are needed"
    return None


def _by_motion(
    prediction: Prediction, torques: NDArray[np.float64], blocks: NDArray[np.int64], robot: Robot
) -> tuple[tuple[SpeedEffect, ...], PlayEffect | None]:
    assert prediction.wheel_angles is not None
    assert prediction.wheel_speeds is not None
    earlier = lagged(prediction.wheel_speeds, prediction.segments, lag=_EARLIER)
    sensors, drive = robot.sensors, robot.drive
    step = encoder_step(encoder_counts=sensors.encoder_counts, gear_ratio=drive.gear_ratio)
    by_speed = tuple(
        speed_effect(torque, speed, blocks) for torque, speed in zip(torques.T, earlier.T, strict=True)
    )
    by_travel = play_effect(
        torques,
        earlier,
        prediction.wheel_angles,
        blocks,
        prediction.segments,
        least_turn=max(_STEPS * step, _LEAST_TURN),
    )
    return by_speed, by_travel


def _by_position(
    prediction: Prediction, torques: NDArray[np.float64], blocks: NDArray[np.int64], robot: Robot
) -> tuple[PositionEffect | None, str | None]:
    """Return the effect in the log whose wheels turned furthest, as each has its own zero, or why there is none."""
    angles = prediction.wheel_angles
    assert angles is not None
    where = max(slices(prediction.logs), key=lambda rows: float(np.ptp(angles[rows], axis=0).min()))
    found = position_effect(torques[where], angles[where], blocks[where], rollers=robot.wheels.rollers)
    turned = float(np.ptp(angles[where], axis=0).min()) / (2.0 * np.pi)
    return found, None if found else (
        f"the wheels covered {turned:.2f} of a turn; at least a whole turn is needed"
    )


def _turning(prediction: Prediction) -> NDArray[np.float64] | None:
    """Return 10 %, 50 % and 90 % of the wheels' speeds (3,) [turns/s]."""
    if prediction.wheel_speeds is None:
        return None
    return np.quantile(np.abs(prediction.wheel_speeds), (0.1, 0.5, 0.9)) / (2.0 * np.pi)

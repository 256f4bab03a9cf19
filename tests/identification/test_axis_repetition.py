"""Motions that repeat themselves: their blocks are held out together, and count as one."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot.identification.axis import AXIS_LAWS, AxisRecord
from ballbot.identification.axis.inverse import regression_rows
from ballbot.identification.axis.prediction import predicted_error
from ballbot.identification.axis.repetition import LEAST_PARTS, parts_at, parts_in, repetition_time
from ballbot.identification.axis.selection import FOLDS, blocks_of
from ballbot.identification.axis.structure import AxisModel
from ballbot.identification.axis.terms import parts_of

RATE = 100.0


def fourier(t: np.ndarray, period: float) -> np.ndarray:
    """Return an excitation of five harmonics, as of the joints of an arm."""
    phases = np.random.default_rng(3).uniform(0.0, 2.0 * np.pi, 5)
    angles = 2.0 * np.pi / period * np.outer(t, np.arange(1, 6)) + phases
    return np.sin(angles) @ (1.0 / np.arange(1, 6))


def record(position: np.ndarray, name: str = "log") -> AxisRecord:
    return AxisRecord(
        name=name, sample_time=1.0 / RATE, force=np.cos(position), position=position, unit="rad"
    )


def repeated(period: float = 10.0, duration: float = 30.0) -> AxisRecord:
    return record(fourier(np.arange(duration * RATE) / RATE, period))


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_time_of_a_repeated_motion_is_found(noise: float) -> None:
    t = np.arange(30.0 * RATE) / RATE
    position = fourier(t, 10.0) + noise * np.random.default_rng(1).standard_normal(len(t))
    # positions are compared every 15 ms
    assert repetition_time(t, position) == pytest.approx(10.0, abs=0.02)
    assert repetition_time(t, fourier(t, 45.0)) == np.inf
    assert repetition_time(t, np.sin(t**1.5)) == np.inf
    assert repetition_time(t, t) == np.inf


def test_a_motion_has_whole_blocks_or_is_not_divided() -> None:
    assert parts_in(10.0, 1.0) == 10
    assert parts_in(2.0, 0.4) == 0  # fewer than two for each that is held out
    assert parts_in(np.inf, 1.0) == 0
    np.testing.assert_array_equal(
        parts_at(np.array([0.5, 3.5, 13.5, 9.999, 29.999]), 10.0, 10), [0, 3, 3, 9, 9]
    )


def test_blocks_that_repeat_each_other_are_held_out_together() -> None:
    """Blocks of one second, taken by turns, would have the same motion among those that are fitted."""
    one = repeated()
    blocks = blocks_of([one])
    assert len(blocks) == 30
    for fold in range(FOLDS):
        starts = {round(blocks.spans[i][1][0] / RATE) % 10 for i in blocks.held_out(fold)}
        others = {round(blocks.spans[i][1][0] / RATE) % 10 for i in blocks.seen(fold)}
        assert not starts & others
    assert sorted(len(group) for group in blocks.groups()) == [3] * 10
    assert [group.tolist() for group in blocks.groups([0, 1, 10])] == [[0, 2], [1]]


def test_a_motion_shorter_than_the_blocks_shortens_them() -> None:
    blocks = blocks_of([repeated(period=5.0)])
    assert blocks.duration == pytest.approx(5.0 / LEAST_PARTS, rel=0.01)
    assert len(set(blocks.parts)) == LEAST_PARTS
    # where noise asks for long ones, they stay long
    assert blocks_of([repeated(period=5.0)], longest=True).duration == pytest.approx(30.0 / 9.0)


def test_blocks_of_other_motions_and_records_are_all_different() -> None:
    blocks = blocks_of([repeated(), record(fourier(np.arange(2000) / RATE, 60.0), "other")])
    first = [part for part, (number, _) in zip(blocks.parts, blocks.spans, strict=True) if number == 0]
    second = [part for part, (number, _) in zip(blocks.parts, blocks.spans, strict=True) if number == 1]
    assert not {*first} & {*second}
    assert len({*second}) == len(second)


def test_forces_are_selected_by_blocks_that_no_other_repeats() -> None:
    one = repeated()
    rows = regression_rows([one], AxisModel(law=AXIS_LAWS["coulomb"]))
    part = parts_of([one], rows)
    seconds = rows.seen["time"]
    np.testing.assert_array_equal(part, np.floor(np.mod(seconds, one.repetition) / one.repetition * 10))
    assert set(part) == set(range(10))


def test_repetitions_do_not_narrow_the_expected_error() -> None:
    """Errors that differ from part to part of the motion, and not from repetition to repetition."""
    blocks = blocks_of([repeated()])
    squares = np.random.default_rng(2).chisquare(2, 10)[np.array(blocks.parts)]
    alone = replace(blocks, parts=tuple(range(len(blocks))))
    together, apart = (predicted_error(squares, one, horizon=0.5) for one in (blocks, alone))
    assert together.error == pytest.approx(apart.error)
    assert together.upper > 1.1 * apart.upper

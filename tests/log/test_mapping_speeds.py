"""Foreign logs with wheel speeds and no angles: they are integrated, and their unit is determined or asked for."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.mapping_inference.conclusions import conclusions_of
from ballbot.log.mapping_inference.evidence import CONFIDENT
from ballbot.log.mapping_inference.proposal import propose
from ballbot.log.mapping_inference.report import Evaluation, evaluate
from ballbot.log.mapping_inference.tolerances import LONGEST_SPEED_DELAY
from ballbot.log.mapping_inference.units import PER_ROW, speed_units
from tests.support.foreign_log_examples import Habits, columns_of, small_robot, swaying_log, write_foreign

Columns = dict[str, np.ndarray]
TURN = 2.0 * math.pi
#: counts in a turn of the wheel
COUNTS = small_robot().sensors.encoder_counts * small_robot().drive.gear_ratio


@pytest.fixture(scope="module")
def angles() -> Columns:
    """Return columns of 25 s with torques and wheel angles in radians."""
    columns = columns_of(swaying_log(), Habits())
    t = columns["t_now"]
    columns = {name: values for name, values in columns.items() if name[0] not in "iu"}
    at = {k: np.interp(t, swaying_log().t, swaying_log()[f"u{k}"]) for k in (1, 2, 3)}
    columns |= {f"torque{k}_Nm": at[k] for k in (1, 2, 3)}
    return {name: values[:2200] for name, values in columns.items()}


@pytest.fixture
def evaluated(tmp_path: Path) -> Callable[..., Evaluation]:
    """Return a function that writes columns as a stranger's file and evaluates its proposal."""

    def made(columns: Columns) -> Evaluation:
        path = write_foreign(tmp_path / "run.csv", columns, Habits(separator=","))
        return evaluate(propose(path, small_robot(), dead_band=0.0), small_robot(), file=path)

    return made


def with_speeds(columns: Columns, form: str, factor: float = 1.0) -> Columns:
    """Return columns with the wheels' true speeds, in a unit of `factor` rad/s, in place of their angles."""
    t, log = columns["t_now"], swaying_log()
    sent = 0.005 * np.floor(t / 0.005)
    others = {name: values for name, values in columns.items() if not name.startswith("psi_")}
    return others | {form.format(k): np.interp(sent, log.t, log[f"wheel{k}_dot"]) / factor for k in (1, 2, 3)}


@pytest.mark.parametrize(
    ("form", "factor", "unit"),
    [
        ("speed{}_rpm", TURN / 60.0, "rpm"),
        ("wheel{}_rev_s", TURN, "turn/s"),
        ("w{}_rps", TURN, "turn/s"),
        ("wheel{}_vel", math.radians(1.0), "deg/s"),
        ("w{}", 1.0, "rad/s"),
    ],
)
def test_a_log_of_wheel_speeds_is_integrated(evaluated, angles: Columns, form, factor, unit):
    found = evaluated(with_speeds(angles, form, factor))
    proposal = found.proposal
    assert proposal.roles.of_speeds
    assert (proposal.wheel.unit, proposal.wheel.factor) == (unit, pytest.approx(factor))
    assert 'angle = { integral_of = "speed" }' in found.text
    assert any(
        "are wheel speeds, whose integrals are taken as the angles" in one.text for one in found.findings
    )
    assert [one.name for one in found.undetermined if "wheel" in one.name] == []


def test_the_mapping_of_speeds_makes_the_log_of_the_angles(evaluated, angles: Columns, tmp_path: Path):
    by_angles, by_speeds = evaluated(angles), evaluated(with_speeds(angles, "speed{}_rpm", TURN / 60.0))
    assert by_speeds.log is not None
    assert by_angles.log is not None
    (tmp_path / "mapping.toml").write_text(by_speeds.text)
    again = Log.read(tmp_path / "run.csv", mapping=tmp_path / "mapping.toml")
    for k in (1, 2, 3):
        np.testing.assert_array_equal(again[f"wheel{k}"], by_speeds.log[f"wheel{k}"])
        turned, speed = by_angles.log[f"wheel{k}"], swaying_log()[f"wheel{k}_dot"]
        same = np.interp(by_angles.log.t, again.t, again[f"wheel{k}"])
        # angles are off by what a row of 10 ms hides of the speed, 0.3 to 0.6 %, and speeds by the 5 ms that they are
        # held, 2.5 to 3.4 %
        assert np.std(same - turned) < 0.02 * np.std(turned)
        assert np.std(np.interp(again.t, swaying_log().t, speed) - again[f"wheel{k}_dot"]) < 0.15 * np.std(
            speed
        )
    (delay,) = (one for one in by_speeds.conclusions if one.name == "delay of the lean")
    assert f"up to {1e3 * LONGEST_SPEED_DELAY:.0f} ms of their filter" in delay.evidence


def test_angles_that_are_called_speeds_are_refused(evaluated, angles: Columns):
    names = {f"psi_{k}": f"speed{k}_rpm" for k in (1, 2, 3)}
    with pytest.raises(
        InputError, match="are called wheel speeds, but the lean follows from them as from angles"
    ):
        evaluated({names.get(name, name): values for name, values in angles.items()})


def test_speeds_by_one_letter_that_the_lean_does_not_follow_are_refused_with_the_entry_for_them(
    evaluated, angles: Columns
):
    random, rows = np.random.default_rng(0), len(angles["t_now"])
    columns = {"t": angles["t_now"], "tilt_x": angles["theta_x"], "tilt_y": angles["theta_y"]}
    columns |= {f"w{k}": random.standard_normal(rows) for k in (1, 2, 3)}
    columns |= {f"tau{k}": angles[f"torque{k}_Nm"] for k in (1, 2, 3)}
    with pytest.raises(
        InputError,
        match=r'speeds \(w1, w2, w3\), but no angles, and the lean does not confirm.*unit = "rad/s"',
    ):
        evaluated(columns)


def test_whole_speeds_without_a_unit_may_be_counts_a_row():
    speeds = np.round(20.0 * np.sin(np.linspace(0.0, 30.0, 3000)))[:, None]
    found = speed_units(speeds, small_robot(), None, interval=0.01)
    counted = {one.unit: one for one in found if one.unit in (PER_ROW, "counts/s")}
    assert counted[PER_ROW].factor == pytest.approx(TURN / COUNTS / 0.01)
    assert counted["counts/s"].factor == pytest.approx(TURN / COUNTS)
    assert found[counted[PER_ROW]] > max(weight for one, weight in found.items() if one.unit == "deg/s")
    named = speed_units(speeds, small_robot(), "rpm", interval=0.01)
    assert max(named, key=lambda one: named[one]).unit == "rpm"


def test_a_speed_beyond_the_motors_is_of_another_unit():
    speeds = 200.0 * np.sin(np.linspace(0.0, 30.0, 3000))[:, None]
    found = speed_units(speeds, small_robot(), None, interval=0.01)
    plain = {one.unit: weight for one, weight in found.items() if one.scale == 1.0}
    assert plain["rad/s"] < min(plain["rpm"], plain["deg/s"]) - 5.0


def test_speeds_in_counts_are_determined_or_asked_for(evaluated, angles: Columns):
    columns = with_speeds(angles, "speed{}", TURN / COUNTS)
    columns |= {f"speed{k}": np.round(columns[f"speed{k}"]) for k in (1, 2, 3)}
    found = evaluated(columns)
    (unit,) = (one for one in conclusions_of(found.proposal) if one.name == "unit of the wheel speeds")
    assert unit.confidence < CONFIDENT or unit.value == f"counts/s, {COUNTS:g} counts a turn"


def test_speeds_that_are_rounded_much_are_asked_for(evaluated, angles: Columns):
    columns = with_speeds(angles, "wheel{}_rad_s")
    size = float(np.std(columns["wheel1_rad_s"]))
    columns |= {name: size * np.round(columns[name] / size) for name in columns if name.startswith("wheel")}
    (asked,) = (one for one in evaluated(columns).undetermined if one.name == "wheel speeds")
    assert "they are rounded to" in asked.evidence

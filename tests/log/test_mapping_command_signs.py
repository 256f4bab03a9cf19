"""Commands without a sign: about a number that stands for zero, or magnitudes with a column of directions each."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ballbot.log import Log
from ballbot.log.mapping_inference.command_signs import directions_of, far_from_zero, never_negative, zero_of
from ballbot.log.mapping_inference.names import read_names
from ballbot.log.mapping_inference.proposal import propose
from ballbot.log.mapping_inference.report import Evaluation, evaluate
from tests.support.foreign_log_examples import Habits, columns_of, small_robot, swaying_log, write_foreign

Columns = dict[str, np.ndarray]
T = 0.01 * np.arange(3000)


@pytest.fixture(scope="module")
def plain() -> Columns:
    """Return columns of 25 s with duties from -1 to 1."""
    columns = columns_of(swaying_log(), Habits(counts=True))
    return {name: values[:2200] for name, values in columns.items() if name != "i"}


@pytest.fixture
def evaluated(tmp_path: Path) -> Callable[[Columns], Evaluation]:
    """Return a function that writes columns as a stranger's file and evaluates its proposal."""

    def made(columns: Columns) -> Evaluation:
        path = write_foreign(tmp_path / "run.csv", columns, Habits(separator=","))
        return evaluate(propose(path, small_robot(), dead_band=0.0), small_robot(), file=path)

    return made


def duties(size: float) -> np.ndarray:
    """Return duties (N, 3) that swing about zero."""
    return size * np.column_stack([np.sin(2.3 * T + k) + 0.5 * np.sin(5.1 * T - k) for k in range(3)])


@pytest.mark.parametrize(
    ("zero", "full"),
    [(128.0, 127.0), (90.0, 90.0), (50.0, 50.0), (1500.0, 500.0), (2048.0, 2047.0), (32768.0, 32767.0)],
)
def test_the_zero_of_commands_is_a_usual_one_near_their_mean(zero, full):
    found = zero_of(np.round(zero + full * duties(0.2)), T)
    assert found is not None
    assert abs(found.value - zero) <= 0.5
    assert full in found.full_scales
    assert zero - found.value in [0.0, *(zero - other for other in found.alternatives), -0.5, 0.5]


def test_the_number_at_which_motors_rest_is_the_zero():
    commands = np.round(1488.0 + 500.0 * duties(0.2))
    commands[:100] = 1488.0
    found = zero_of(commands, T)
    assert found is not None
    assert (found.value, dict(found.full_scales)) == (1488.0, {500.0: 1.0, 400.0: 0.3})
    assert "while the motors rest, all are 1488" in found.evidence


def test_zeros_that_differ_by_much_of_the_commands_are_asked_for():
    found = zero_of(np.round(128.0 + 3.0 * duties(1.0)), T)
    assert found is not None
    assert found.confidence < 0.9
    assert {found.value, *found.alternatives} == {127.0, 127.5, 128.0}


def test_commands_about_an_unusual_number_have_no_zero():
    assert zero_of(np.round(300.0 + 20.0 * duties(1.0)), T) is None
    # beyond the full scale of the only zero near
    assert zero_of(np.round(90.0 + 85.0 * duties(1.0)), T) is None


def test_magnitudes_are_near_zero_and_centred_duties_far_from_it():
    assert not never_negative(duties(0.2))
    magnitudes, centred = np.abs(duties(0.2)), 128.0 + 127.0 * duties(0.2)
    assert never_negative(magnitudes)
    assert never_negative(centred)
    assert not far_from_zero(magnitudes)
    assert far_from_zero(centred)


@pytest.mark.parametrize(("zero", "full"), [(128.0, 127.0), (1500.0, 500.0)])
def test_a_log_of_duties_about_a_number_makes_the_log_of_signed_duties(
    evaluated, plain: Columns, tmp_path: Path, zero, full
):
    signed = evaluated({name: full * values if name[0] == "u" else values for name, values in plain.items()})
    found = evaluated({name: zero + full * v if name[0] == "u" else v for name, v in plain.items()})
    # fractions leave no question of the zero's last digit: all that is left are questions of the signed log
    asked = {one.name for one in found.undetermined}
    assert asked <= {one.name for one in signed.undetermined} | {
        "zero of the commands",
        "full scale of the duty",
    }
    assert found.proposal.drive is not None
    assert (found.proposal.drive.unit.kind, 1.0 / found.proposal.drive.unit.scale) == (
        "duty",
        pytest.approx(full, rel=0.01),
    )
    assert f"zero = {found.proposal.roles.zero.value}" in found.text
    filled = found.text.replace("complete = false", "complete = true")
    filled = filled.replace(f"zero = {found.proposal.roles.zero.value}", f"zero = {zero}")
    (tmp_path / "mapping.toml").write_text(filled)
    (tmp_path / "signed.toml").write_text(filled.replace(f"zero = {zero}", "zero = 0.0"))
    log = Log.read(tmp_path / "run.csv", mapping=tmp_path / "mapping.toml")
    write_foreign(
        tmp_path / "run.csv",
        {name: full * v if name[0] == "u" else v for name, v in plain.items()},
        Habits(separator=","),
    )
    same = Log.read(tmp_path / "run.csv", mapping=tmp_path / "signed.toml")
    np.testing.assert_allclose(log.torques, same.torques, atol=1e-9)


@pytest.mark.parametrize("backward", [0.0, -1.0])
def test_magnitudes_with_directions_make_the_log_of_signed_duties(
    evaluated, plain: Columns, tmp_path: Path, backward
):
    columns = {name: np.abs(v) if name[0] == "u" else v for name, v in plain.items()}
    columns |= {f"dir{k}": np.where(plain[f"u{k}"] > 0.0, 1.0, backward) for k in (1, 2, 3)}
    signed, found = evaluated(plain), evaluated(columns)
    assert found.proposal.roles.directions == ("dir1", "dir2", "dir3")
    assert [one.name for one in found.undetermined] == [one.name for one in signed.undetermined]
    assert found.proposal.drive is not None
    assert signed.proposal.drive is not None
    assert found.proposal.drive.assigned == signed.proposal.drive.assigned
    assert any("forward where dir1, dir2, dir3 are above zero" in one.text for one in found.findings)
    text = found.text.replace("complete = false", "complete = true")
    (tmp_path / "mapping.toml").write_text(text)
    log = Log.read(tmp_path / "run.csv", mapping=tmp_path / "mapping.toml")
    write_foreign(tmp_path / "run.csv", plain, Habits(separator=","))
    lines = [one for one in text.splitlines() if not one.startswith("names =")]
    (tmp_path / "signed.toml").write_text("\n".join(one for one in lines if not one.startswith("direction")))
    same = Log.read(tmp_path / "run.csv", mapping=tmp_path / "signed.toml")
    np.testing.assert_allclose(log.torques, same.torques, atol=1e-12)


def test_directions_are_taken_if_one_series_of_columns_may_be_them():
    names = ["pwm1", "pwm2", "dir1", "dir2", "speed1", "speed2", "fault1", "fault2"]
    on = np.where(np.sin(T) > 0.0, 1.0, 0.0)
    columns = dict.fromkeys(names, np.abs(np.sin(T))) | {"dir1": on, "dir2": 1.0 - 2.0 * on}
    readings, motors = read_names(names), ("pwm2", "pwm1")
    assert directions_of(readings, columns, motors) == ("dir2", "dir1")
    assert directions_of(readings, columns | {"fault1": on, "fault2": on}, motors) == ()
    assert directions_of(readings, columns | {"dir1": 2.0 * on}, motors) == ()
    assert directions_of(readings, columns | {"dir1": 0.0 * on}, motors) == ()

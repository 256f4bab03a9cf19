"""Where friction matters: the verdicts from errors that are known, and where the margins end."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ballbot.control.controller import Controller
from ballbot.control.presets import precise_controller
from ballbot.report.study import stiffness_sentences
from ballbot.twin.faults import Compliance, CurrentLoop, Timing
from ballbot.twin.scenario import Scenario
from ballbot.workflows import stiffness
from ballbot.workflows.controller_choice import SQUARE, ControllerChoice, PlantDraw, Trial
from ballbot.workflows.metrics import Score
from ballbot.workflows.stiffness import VARIANTS, FrictionByStiffness, Stiffness, measure_stiffness
from tests.support.control_examples import FRICTION, alten
from tests.support.scores import score_of

PLAIN = VARIANTS[0]
ROBOT = alten(FRICTION)
#: of ten robots
SPREAD = np.linspace(0.9, 1.1, 10)


@cache
def controller() -> Controller:
    return precise_controller(ROBOT)


def trial(peak: float, ended: str | None = None) -> Trial:
    scores: list[Score] = [score_of(peak * factor) for factor in SPREAD]
    scores[0] = replace(scores[0], ended=ended)
    return Trial(controller=controller(), scores=tuple(scores))


def found(
    plain: list[float], compensated: list[float], *, sensitivity: float = 1.0, ended: str | None = None
) -> FrictionByStiffness:
    """Return gains of 1, 2, 3, ... N m/m; sensitivity and end are those of the last."""
    gains = []
    for place, (without, with_it) in enumerate(zip(plain, compensated, strict=True), start=1):
        last = place == len(plain)
        one = trial(without, ended if last else None)
        gains.append(
            Stiffness(
                position_gain=float(place),
                sensitivity=sensitivity if last else 1.0,
                trials={v: trial(with_it) if v.compensation else one for v in VARIANTS},
            )
        )
    return FrictionByStiffness(course=SQUARE, gains=tuple(gains), precise_gain=2.0, margins_end=False)


def stiffest(one: FrictionByStiffness) -> float | None:
    gain = one.stiffest(PLAIN)
    return None if gain is None else gain.position_gain


def test_the_stiffest_gain_is_the_last_before_errors_grow_margins_end_or_a_run_falls():
    falling = [0.3, 0.1, 0.03]
    assert stiffest(found(falling, falling)) == 3.0
    assert stiffest(found([0.3, 0.1, 0.105], falling)) == 3.0  # intervals overlap: not clearly larger
    assert stiffest(found([0.3, 0.1, 0.2], falling)) == 2.0
    assert stiffest(found(falling, falling, sensitivity=2.1)) == 2.0
    assert stiffest(found(falling, falling, ended="fallen")) == 2.0
    assert stiffest(found([0.3], [0.3], ended="fallen")) is None


def test_compensation_pays_where_the_interval_of_the_ratio_is_above_one():
    for with_it, paying in (
        ([0.1, 0.05, 0.02, 0.011], [1.0, 2.0, 3.0]),
        ([0.3, 0.05, 0.02, 0.011], [2.0, 3.0]),
        ([0.1, 0.1, 0.02, 0.011], [1.0]),  # the third may be chance
        ([0.3, 0.1, 0.03, 0.01], []),
    ):
        one = found([0.3, 0.1, 0.03, 0.01], with_it)
        for observer in (False, True):
            assert [gain.position_gain for gain in one.pays_over(observer=observer)] == paying
    assert "as stiff as 4.0 N m/m" in stiffness_sentences(one)


def test_compensation_that_makes_runs_fall_does_not_pay():
    one = found([0.3], [0.1])
    fallen = {v: trial(0.1, "fallen") if v.compensation else t for v, t in one.gains[0].trials.items()}
    assert replace(one, gains=(replace(one.gains[0], trials=fallen),)).pays_over(observer=False) == ()


def measured(monkeypatch: pytest.MonkeyPatch, scenario: Scenario) -> FrictionByStiffness:
    """Return three gains on two robots in a scenario, on 8 s of the square."""
    monkeypatch.setattr(stiffness, "_GAINS", 3)
    plants = tuple(PlantDraw(robot=ROBOT, known=ROBOT, scenario=scenario, seed=seed) for seed in (0, 1))
    base = Trial(controller=controller(), scores=())
    choice = ControllerChoice(
        plants=plants, course=replace(SQUARE, duration=8.0), trials={"precise": base}, equals=(), chosen=None
    )
    return measure_stiffness(choice)


@pytest.mark.slow
def test_delay_lag_and_resonance_end_the_margins_at_a_softer_gain(monkeypatch):
    nominal = Scenario.nominal(ROBOT)
    late = replace(nominal, timing=Timing(delay=2), current_loop=CurrentLoop(bandwidth=20.0))
    twisting = replace(nominal, compliance=Compliance(frequency=30.0, damping_ratio=0.05))
    ends = []
    for scenario in (nominal, late, twisting):
        one = measured(monkeypatch, scenario)
        gains = [each.position_gain for each in one.gains]
        assert one.margins_end == (scenario is not nominal)
        assert one.gains[0].sensitivity < one.gains[-1].sensitivity
        ends.append(gains[-1])
    assert ends[0] > 1.5 * max(ends[1:])
    # what the robot wanders is the friction over the position gain: over thrice the gain less than half
    peaks = [1e3 * each.trials[PLAIN].peak.median for each in one.gains]
    assert gains[-1] > 3.0 * gains[0]
    assert peaks[-1] < 0.5 * peaks[0]

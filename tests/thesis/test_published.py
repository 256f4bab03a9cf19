"""The thesis's approximations and their shares, the other published robots, and the page."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from ballbot.control.controller import Controller
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import Formulation
from ballbot.robot import Robot
from ballbot.robot.components import PARAMETERS, Friction
from ballbot.thesis.reproduce import mistakes
from campaigns.published import alten, kugle, page, rezero
from campaigns.published.printed import mixture_model, track, unstable_poles
from tests.support.lagrangian import corrections_of, equations
from tests.support.paths import ROOT
from tests.support.symbolic_oracle import random_state

ALTEN = Robot.load("alten")
PUBLISHED = ("alten", "rezero", "kugle", "rob311", "cmu")

# --- presets --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PUBLISHED)
def test_every_parameter_of_a_preset_has_a_source(name: str) -> None:
    assert set(Robot.load(name).sources) == {parameter.name for parameter in PARAMETERS}


@pytest.mark.parametrize(("name", "wheels"), [("rezero", 3), ("kugle", 3), ("rob311", 3), ("cmu", 4)])
def test_a_preset_is_a_robot_that_falls_and_can_be_held(name: str, wheels: int) -> None:
    robot = Robot.load(name)
    model = Model(robot).linearize()
    design = alten.nominal_lqr(robot, model)
    assert robot.wheel_count == wheels
    assert 3.0 < unstable_poles(model)[1] <= unstable_poles(model)[0] < 7.0
    assert design.poles.real.max() < 0.0


def test_cmus_own_planar_equations_are_ours_without_the_wheels_inertia() -> None:
    cmu = Robot.load("cmu")
    ours = unstable_poles(Model(page.without_wheel_inertia(cmu)).linearize())
    assert ours == pytest.approx((page.planar_pole(cmu),) * 2, rel=1e-12)


# --- entries --------------------------------------------------------------------------------------


# --- the thesis -----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["thesis", "exact"])
def test_mixtures_end_in_the_two_formulations(formulation: Formulation) -> None:
    mixture = mixture_model(ALTEN, corrections_of(formulation))
    model = Model(ALTEN, formulation).linearize()
    assert pytest.approx(model.A, abs=1e-10) == mixture.A
    assert pytest.approx(model.B, abs=1e-10) == mixture.B


def test_shapley_shares_of_a_known_game() -> None:
    """Two that only act together share it equally; one that acts alone has its own; one that does not has none."""
    names = alten.AT_REST

    def value(mixture: frozenset[str]) -> float:
        return 6.0 * ({names[0], names[1]} <= mixture) + 5.0 * (names[2] in mixture)

    found = alten.shares({mixture: value(mixture) for mixture in alten.mixtures()})
    assert [found[name] for name in names] == pytest.approx([3.0, 3.0, 5.0, 0.0])


@pytest.mark.slow
def test_the_exact_models_gain_tracks_the_exact_model_better() -> None:
    gains = [alten.nominal_lqr(ALTEN, Model(ALTEN, name).linearize()).gain for name in ("thesis", "exact")]
    by_thesis, by_exact = track(Model(ALTEN), [Controller(ALTEN, gain) for gain in gains])
    assert not by_thesis.fell
    assert by_exact.settled_error < 0.5 * by_thesis.settled_error
    assert 0.0 < by_exact.settled_error < by_exact.rms_error < 0.5


@pytest.mark.slow
def test_force_of_mistake_16_is_that_of_the_symbolic_lagrangian() -> None:
    """(II.34) as printed less (II.34) with d'Alembert's principle first, derived by SymPy, at some states."""
    printed = corrections_of("thesis")
    first, second = (
        equations(ALTEN, replace(printed, nonholonomic_wheels=mended)) for mended in (False, True)
    )
    rng = np.random.default_rng(16)
    for _ in range(20):
        q, q_dot, _ = random_state(rng, 3)
        force = mistakes.nonholonomic_force(ALTEN, q, q_dot)
        # central differences at 1e-5: truncation and rounding are 1e-10 of numbers up to 0.1
        wanted = first.bias(q, q_dot) - second.bias(q, q_dot)
        np.testing.assert_allclose(force, wanted, rtol=0.0, atol=1e-9)


# --- the page -------------------------------------------------------------------------------------

NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")


@pytest.mark.sample
def test_the_page_in_docs_is_what_the_command_computes() -> None:
    """Words exactly; numbers to 1 %, as stick-slip runs differ between processors in their last digits.

    All but the shares of the approximations, whose sixteen derivations take minutes; the first and the last of them are
    tested above.
    """
    committed = (ROOT / "docs" / "generated" / "published_models.md").read_text(encoding="utf-8")
    words, numbers = NUMBER.sub("\0", committed), NUMBER.findall(committed)
    robot = ALTEN.replace(friction=Friction.none(3))
    load = Robot.load
    for part in (
        alten._model_part(robot),
        kugle.section(load("kugle")),
        rezero.section(load("rezero")),
        page.parameters_section(load("rob311"), load("cmu")),
    ):
        begin = words.index(NUMBER.sub("\0", part))
        first, computed = words[:begin].count("\0"), NUMBER.findall(part)
        assert [float(one) for one in computed] == pytest.approx(
            [float(one) for one in numbers[first : first + len(computed)]], rel=1e-2, abs=5e-4
        )

"""Contacts that are springs of a stiffness in N/m, in the terms of MuJoCo's solver.

For a contact at depth r that gives way at v, its solver finds the force from (A + R) f + a_0 = -b v - k d r, with
the contact's acceleration a = A f + a_0 and R = (1 - d)/d m, where d is the impedance and m the sum of the two
bodies' inverse weights (MuJoCo's documentation, "Computation", constraint model). So

    f = K r + C v - a/R        K = k d / R        C = b / R

a spring, a damper, and a mass 1/R = d/(1 - d) / m that is not there; a small d keeps that small (some 0.3 kg for
each of the BBR's contacts). Written into
`solref` as -k d^2 and -b d. Friction shares R; it has a damper of its own and a high ratio of impedances, so that
a wheel that grips creeps little.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

from ballbot.errors import InputError
from ballbot.twin.engine import Engine
from ballbot.twin.faults import Softness
from ballbot.twin.numbers import text
from ballbot.twin.scenario import Scenario

_IMPEDANCE = 0.2  # d
_IMPEDANCE_RATIO = 100.0  # of friction to normal force; 10 elsewhere
_LARGEST_STEP = 1.0  # k d h^2 and b h at most: beyond, the contact jumps from step to step


def add_soft_contacts(root: ET.Element, scenario: Scenario, hard: str) -> None:
    """Make every contact of a roller with the ball a soft one.

    Parameters
    ----------
    root : Element
        The document; its ball and rollers must not touch by themselves.
    scenario : Scenario
        Has softness.
    hard : str
        The same document without softness: from it MuJoCo tells the bodies' inverse weights.

    Raises
    ------
    InputError
        Where the contacts are too stiff for the timestep, or MuJoCo is not installed.
    """
    softness = scenario.softness
    if softness is None:
        return
    option = root.find("option")
    if option is not None:
        option.set("impratio", text(_IMPEDANCE_RATIO))
    pairs = root.find("contact")
    if pairs is None:
        pairs = ET.SubElement(root, "contact")
    engine = Engine(hard)
    ball = engine.mobility("ball")
    grip = scenario.roller_grip
    names = [body.get("name", "") for body in root.iter("body")]
    for name in (name for name in names if name.startswith("roller ")):
        ET.SubElement(
            pairs,
            "pair",
            geom1="ball",
            geom2=name,
            condim="3",
            friction=text((grip, grip, 0.0, 0.0, 0.0)),
            solref=_reference(softness, ball + engine.mobility(name), scenario.timestep),
            solreffriction=text((-1.0, -0.5 * _IMPEDANCE / scenario.timestep)),
            solimp=text((_IMPEDANCE, _IMPEDANCE, 0.001)),
        )


def _reference(softness: Softness, mobility: float, step: float) -> str:
    d = _IMPEDANCE
    R = (1 - d) / d * mobility
    k_d, b = softness.stiffness * R, softness.damping * R
    if k_d * step**2 > _LARGEST_STEP or b * step > _LARGEST_STEP:
        stiffest, most = _LARGEST_STEP / (R * step**2), _LARGEST_STEP / (R * step)
        raise InputError(
            f"softness.stiffness is {softness.stiffness:g} N/m and softness.damping "
            f"{softness.damping:g} N s/m; with a timestep of {step:g} s they must "
            f"be below {stiffest:.2g} and {most:.2g}. Reduce them or the timestep."
        )
    return text((-k_d * d, -b * d))

"""Logs of the nominal twin under the nominal gain, and the friction that two of them show."""

from dataclasses import replace

from ballbot.control.presets import nominal_controller
from ballbot.control.references import named_reference
from ballbot.identification import Identification, identify
from ballbot.log import Log
from ballbot.robot import Friction, Robot
from ballbot.simulation.run import simulate
from ballbot.twin import Scenario, Twin

_PRESET = Robot.load("alten")
#: with a resistance [ohm] that its motors could have, for scenarios with a battery
ROBOT = _PRESET.replace(drive=replace(_PRESET.drive, resistance=0.6))
NOMINAL = Scenario.nominal(ROBOT)


def twin_log(reference: str, *, duration: float, seed: int, scenario: Scenario = NOMINAL) -> Log:
    """Return a log of the twin by its own sensors, without compensation."""
    twin, controller = Twin(ROBOT, scenario), nominal_controller(ROBOT)
    course = named_reference(reference)
    return simulate(twin, controller, course, duration=duration, seed=seed).without_truth()


def identified() -> Identification:
    """Return the identification from two logs of 48 s, as in the demo."""
    references = ("square", "figure_eight")
    logs = [twin_log(name, duration=48.0, seed=seed) for seed, name in enumerate(references, start=1)]
    return identify(ROBOT, logs, seed=0)


def asymmetric(friction: Friction, fraction: float) -> Friction:
    """Return friction whose dry terms are (1 + fraction) times as large forward, (1 - fraction) times backward."""
    return replace(
        friction,
        coulomb_asymmetry=tuple(fraction * c for c in friction.coulomb),
        stribeck_asymmetry=tuple(fraction * s for s in friction.stribeck),
    )

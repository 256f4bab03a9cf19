"""An update of the exported Python module beside one of the package, by the clock, with the same readings.

.venv/bin/python -m benchmarks.python_loop
"""

import importlib.util
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.references import circle
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import Reading
from ballbot.files import write_text
from ballbot.firmware.export import export_controller
from ballbot.firmware.python_loop import MODULE, PYTHON_PROJECT, python_module
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.run import simulate

SAMPLES = 4000


def exported_update(
    controller: Controller, rows: list[dict[str, float]], folder: Path
) -> Callable[[int], object]:
    """Return the update of the module that is exported into a folder."""
    exported = export_controller(controller, project=PYTHON_PROJECT)
    for name, text in {**exported.files, MODULE: python_module(controller, None)}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_text(folder / name, text)
    spec = importlib.util.spec_from_file_location("ballbot_loop", folder / MODULE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    loop = module.Loop()
    loop.skip_self_test()
    loop.arm()

    def update(k: int) -> None:
        loop.update(0.005 * k, rows[k])
        assert loop.active, loop.stop

    return update


def package_update(controller: Controller, rows: list[dict[str, float]]) -> Callable[[int], object]:
    """Return the update of filter and law in the package, compiled by Numba."""
    estimator = named_estimator(controller.estimator, controller.robot, sample_time=controller.sample_time)
    estimator.reset()
    controller.reset()
    table = np.array([[*row.values()] for row in rows])
    readings = [
        Reading(wheel_angles=row[:3], wheel_speeds=np.zeros(3), gyro=row[3:6], attitude=row[6:])
        for row in table
    ]
    reference = np.zeros(10)
    return lambda k: controller.update(0.005 * k, estimator.update(readings[k]), reference)


def median_time(update: Callable[[int], object]) -> float:
    """Return the median time of an update [us]."""
    times = []
    for k in range(SAMPLES):
        started = perf_counter()
        update(k)
        times.append(perf_counter() - started)
    return 1e6 * float(np.median(times))


def main() -> None:
    """Print the times of two controllers."""
    robot = Robot.load("alten")
    names = (*(f"wheel{i}" for i in (1, 2, 3)), "gyro_x", "gyro_y", "gyro_z", "theta", "phi", "psi")
    for name, controller in (("nominal", nominal_controller(robot)), ("precise", precise_controller(robot))):
        log = simulate(Model(robot), controller, circle(radius=0.5, period=12.0), duration=0.005 * SAMPLES)
        rows = [{name: float(log[name][k]) for name in names} for k in range(SAMPLES)]
        with tempfile.TemporaryDirectory() as folder:
            module = median_time(exported_update(controller, rows, Path(folder)))
        package = median_time(package_update(controller, rows))
        sys.stdout.write(
            f"{name}, {controller.estimator}: {module:.0f} us by the module, {package:.0f} us by the package\n"
        )


if __name__ == "__main__":
    main()

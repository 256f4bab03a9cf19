"""Control periods a second of the compiled closed loop, and of the same robot called one sample at a time.

.venv/bin/python -m benchmarks.closed_loop

A period is 5 ms: all sensors with their faults, the Kalman filter, the precise controller with all its parts, a delay
of one sample, motors' lag, play, and five steps of 1 ms.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

from ballbot.control.presets import precise_controller
from ballbot.control.references import square
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.run import simulate
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.simulation.sensors import SensorFaults
from ballbot.twin import Scenario
from ballbot.twin.imperfections import imperfections_of
from benchmarks.workloads import nominal_robot

PERIOD = 0.005
LANES = 512


def imperfections(robot: Robot) -> Imperfections:
    """Return everything that a period has."""
    return Imperfections(
        sensors=robot.sensors,
        sensor_faults=SensorFaults(gyro_bias=0.001, gyro_bias_walk=1e-5, lean_error=0.003, latency=0.005),
        delay=1,
        lag=0.002,
        torque_noise=0.01,
        backlash=math.radians(1.0),
    )


def periods_a_second(lanes: int, *, duration: float, threads: int = 1) -> float:
    """Return the control periods a second of so many robots, the best of five runs."""
    robot = nominal_robot()
    model, controller = Model(robot), precise_controller(robot).with_estimator("kalman")

    def run(seconds: float) -> None:
        simulate_batch(
            [model] * lanes,
            controller,
            square(),
            duration=seconds,
            imperfections=imperfections(robot),
            every=0,
            threads=threads,
        )

    run(PERIOD)
    return lanes * duration / PERIOD / _best(lambda: run(duration))


def costs_of_imperfections() -> dict[str, tuple[float, float]]:
    """Return each imperfection's share of a period: where every robot has it, and of the others if one of 512 has it.

    The second is the cost of an imperfection that is switched off.
    """
    robot = nominal_robot()
    rollers = imperfections_of(Scenario.nominal(robot)).contacts
    every = replace(
        imperfections(robot), contacts=rollers, load_dependence=0.5, slope=(0.01, 0.0), imbalance=(0.02, 0.0)
    )
    off = {
        "sensor_faults": None,
        "delay": 0,
        "lag": 0.0,
        "torque_noise": 0.0,
        "contacts": None,
        "load_dependence": 0.0,
        "slope": (0.0, 0.0),
        "imbalance": (0.0, 0.0),
    }
    model, controller = Model(robot), precise_controller(robot).with_estimator("kalman")

    def run(by_lane: list[Imperfections]) -> None:
        simulate_batch(
            [model] * LANES, controller, square(), duration=0.3, imperfections=by_lane, every=0, threads=1
        )

    run([every] * LANES)
    with_all, costs = _best(lambda: run([every] * LANES)), {}
    for name, value in off.items():
        without = replace(every, **{name: value})
        none, single = (
            _best(lambda b=b: run(b)) for b in ([without] * LANES, [every, *[without] * (LANES - 1)])
        )
        costs[name] = (with_all / none - 1.0, single / none - 1.0)
    return costs


def periods_one_at_a_time(*, duration: float) -> float:
    """Return the control periods a second of the same robot and controller, called from Python sample by sample."""
    robot = nominal_robot()
    controller = precise_controller(robot).with_estimator("kalman")
    plant = SensedPlant(Model(robot), imperfections(robot), estimator="kalman")

    def run(seconds: float) -> None:
        simulate(plant, controller, square(), duration=seconds)

    run(PERIOD)
    return duration / PERIOD / _best(lambda: run(duration))


def _best(run: Callable[[], None]) -> float:
    """Return the shortest of five times [s]."""
    times = []
    for _ in range(5):
        started = perf_counter()
        run()
        times.append(perf_counter() - started)
    return min(times)


def rows() -> list[tuple[str, str, str]]:
    """Return the rows of the table of timings."""
    batched = periods_a_second(LANES, duration=2.0)
    alone = periods_a_second(1, duration=60.0)
    two = periods_a_second(LANES, duration=2.0, threads=2)
    plant = periods_one_at_a_time(duration=2.0)
    return [
        (
            f"closed loop, {LANES} robots: sensors, Kalman filter, precise controller, delay, lag, play",
            f"{batched / 1e6:.2f} million periods/s",
            "0.3, aim 0.5",
        ),
        ("closed loop, one robot, the same", f"{alone / 1e6:.2f} million periods/s", "0.15"),
        ("closed loop, two threads over one", f"{two / batched:.2f} times", "1.8"),
        ("the same robot called from Python, sample by sample", f"{plant / 1e6:.4f} million periods/s", ""),
        *(
            (
                f"share of a period of `{name}`, on; off, beside one of {LANES} with it",
                f"{100.0 * on:+.0f} %; {100.0 * beside:+.0f} %",
                "off: 5 %",
            )
            for name, (on, beside) in costs_of_imperfections().items()
        ),
    ]


if __name__ == "__main__":
    for name, value, wanted in rows():
        print(f"{name}: {value} (wanted {wanted or '-'})")

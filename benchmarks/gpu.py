"""The engine on a GPU: RK4 with known signs, and the stick-slip method on a balancing robot's states.

.venv/bin/python -m benchmarks.gpu          needs a CUDA device and numba-cuda
"""

from __future__ import annotations

import sys
from time import perf_counter

import numpy as np
from numba import cuda

from ballbot.mechanics.engine import cuda as engine
from ballbot.mechanics.engine.run import Lanes, simulate_lanes
from ballbot.mechanics.model import Model
from benchmarks.workloads import balancing, nominal_robot, smooth

STEPS, SAMPLES, SAMPLE_TIME = 5, 200, 0.005


def rate(model: Model, initial: np.ndarray, torques: np.ndarray) -> float:
    """Return robot steps a second of the kernel alone, the best of three."""
    robots = len(initial)
    rows = cuda.to_device(engine.packed_in_lanes(model.packed[None], robots))
    inputs, unsettled = cuda.to_device(torques), cuda.device_array(robots, np.int64)
    best = 0.0
    for _ in range(4):
        states = cuda.to_device(initial)
        cuda.synchronize()
        started = perf_counter()
        blocks = -(-robots // engine._THREADS)
        engine._advance[blocks, engine._THREADS](
            model.selected, rows, states, inputs, SAMPLE_TIME / STEPS, STEPS, unsettled
        )
        cuda.synchronize()
        best = max(best, robots * len(torques) * STEPS / (perf_counter() - started))
    print(f"  unsettled steps: {unsettled.copy_to_host().sum() / (robots * len(torques) * STEPS):.2e}")
    return best


def difference(model: Model, initial: np.ndarray, torques: np.ndarray) -> float:
    """Return the largest difference between GPU and processor after the run."""
    times = {"sample_time": SAMPLE_TIME, "steps": STEPS}
    lanes = Lanes(parameters=model.packed[None], initial=initial, torques=torques[None])
    here = simulate_lanes(model.selected, lanes, **times).states[:, -1]
    there = engine.simulate_on_gpu(
        model.selected, parameters=model.packed[None], initial=initial, torques=torques, **times
    ).finals
    return float(np.abs(here - there).max())


def main() -> None:
    """Print the table."""
    model = Model(nominal_robot())
    print(cuda.get_current_device().name.decode(), "numba", sys.modules["numba"].__version__)
    for name, (initial, all_torques) in {"smooth": smooth(2**20), "stick-slip": balancing(2**20)}.items():
        torques = all_torques[0]
        print(name, f"difference to the processor: {difference(model, initial[:256], torques[:20]):.2e}")
        for count in (2**14, 2**17, 2**20):
            print(
                name,
                count,
                f"{rate(model, initial[:count], torques) / 1e6:.0f} million steps a second",
                flush=True,
            )


if __name__ == "__main__":
    main()

"""Environment steps a second, beside Gymnasium's own vectors of the single environment in the same run.

.venv/bin/python -m benchmarks.environments

A step is one sample of 5 ms (`repeat=1`), resets included. Robots have the nominal scenario's sensors, play and noise.
"""

from __future__ import annotations

import os
from time import perf_counter, process_time

import gymnasium
import numpy as np

NAME = "ballbot.gym:ballbot/Balance-v0"  # Gymnasium imports the module, which registers it
LANES = 2000
#: what others state, with their machines; not measured here
PUBLISHED = (
    ("EnvPool, MuJoCo's Ant (Weng et al. 2022)", "3.1 million", "DGX A100, 256 cores"),
    ("PufferLib, its own games", "4 million", "a GPU"),
    ("Crazyflow, quadrotors through Gymnasium", "0.098 million", "a GPU"),
    ("Crazyflow, quadrotors without", "100 million", "a GPU"),
    ("OpenBallBot-RL, a ballbot in MuJoCo", "203", "one robot"),
)


def steps_a_second(
    envs: gymnasium.vector.VectorEnv, *, size: float, seconds: float = 2.0
) -> tuple[float, float]:
    """Return environment steps a second of the clock, and of the processors' time, with actions U(-size, size)."""
    random = np.random.default_rng(1)
    actions = random.uniform(-size, size, (64, *(envs.action_space.shape or ()))).astype(np.float32)
    envs.reset(seed=1)
    for row in actions:
        envs.step(row)
    begun, spent, steps = perf_counter(), process_time(), 0
    while perf_counter() - begun < seconds:
        envs.step(actions[steps % 64])
        steps += 1
    wall, cpu = perf_counter() - begun, process_time() - spent
    envs.close()
    return steps * envs.num_envs / wall, steps * envs.num_envs / cpu


def ours(*, size: float, threads: int, base: str | None, observe: str) -> tuple[float, float]:
    """Return steps a second of many lanes."""
    envs = gymnasium.make_vec(
        NAME,
        num_envs=LANES,
        repeat=1,
        threads=threads,
        base=base,
        observe=observe,
        copy=False,
        autoreset_mode="SameStep",
    )
    return steps_a_second(envs, size=size)


def gymnasiums(mode: str, num_envs: int) -> float:
    """Return steps a second of Gymnasium's own vector of our single environment."""
    envs = gymnasium.make_vec(NAME, num_envs=num_envs, vectorization_mode=mode, repeat=1)
    return steps_a_second(envs, size=0.3)[0]


def rows() -> list[tuple[str, str, str]]:
    """Return the rows of the table of timings."""
    cores = os.cpu_count() or 1
    cases = (
        ("sensors and Kalman filter, random torques", None, "sensors", 0.3, "0.5, aim 1"),
        ("the same, added to the nominal controller", "nominal", "sensors", 0.05, ""),
        ("true state, random torques", None, "state", 0.3, "2"),
    )
    table = []
    for name, base, observe, size, wanted in cases:
        for threads in sorted({1, cores}):
            wall, cpu = ours(size=size, threads=threads, base=base, observe=observe)
            what = f"environment steps of 5 ms, {LANES} robots, {threads} threads: {name}"
            value = f"{wall / 1e6:.2f} million/s; {cpu / 1e6:.2f} a second of one core"
            table.append((what, value, wanted if threads == cores else ""))
    table += [
        (
            "the same environment, 8 in Gymnasium's SyncVectorEnv",
            f"{gymnasiums('sync', 8) / 1e6:.4f} million/s",
            "",
        ),
        (
            "the same environment, 8 in Gymnasium's AsyncVectorEnv",
            f"{gymnasiums('async', 8) / 1e6:.4f} million/s",
            "",
        ),
    ]
    return table


def published() -> list[str]:
    """Return the lines of the table of what others state."""
    lines = ["Published by others, steps a second:", "", "| | steps a second | on |", "|---|---:|---|"]
    return [*lines, *(f"| {name} | {rate} | {machine} |" for name, rate, machine in PUBLISHED)]


if __name__ == "__main__":
    for name, value, wanted in rows():
        print(f"{name}: {value} (wanted {wanted or '-'})")
    print("\n".join(published()))

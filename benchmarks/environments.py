"""Environment steps a second, beside Gymnasium's own vectors of the single environment in the same run.

.venv/bin/python -m benchmarks.environments     writes this section of docs/generated/benchmarks.md alone

A step is one sample of 5 ms (`repeat=1`), resets included. Robots have the nominal scenario's sensors, play and noise.
"""

import os
from time import perf_counter, process_time

import gymnasium
import numpy as np

from ballbot.files import write_text
from benchmarks.workloads import PAGE, processor

HEADING = "## Environments for learning"
NAME = "ballbot.gym:ballbot/Balance-v0"  # Gymnasium imports the module, which registers it
LANES = 800
#: what others state, with their machines; not measured here
PUBLISHED = (
    ("EnvPool, MuJoCo's Ant (Weng et al. 2022)", "3.1 million", "DGX A100, 256 cores"),
    ("PufferLib, its own games", "4 million", "a GPU"),
    ("Crazyflow, quadrotors through Gymnasium", "0.098 million", "a GPU"),
    ("Crazyflow, quadrotors without", "100 million", "a GPU"),
    ("OpenBallBot-RL, a ballbot in MuJoCo", "203", "one robot"),
)


def steps_a_second(envs: gymnasium.vector.VectorEnv, *, size: float) -> tuple[float, float]:
    """Return environment steps a second, by the clock and by the processors' time: the medians of 60 spells of 0.04 s.

    Actions are U(-size, size).
    """
    random = np.random.default_rng(1)
    actions = random.uniform(-size, size, (64, *(envs.action_space.shape or ()))).astype(np.float32)
    envs.reset(seed=1)
    for row in actions:
        envs.step(row)
    rates = []
    for _ in range(60):
        begun, spent, steps = perf_counter(), process_time(), 0
        while perf_counter() - begun < 0.04:
            envs.step(actions[steps % 64])
            steps += 1
        done = steps * envs.num_envs
        rates.append((done / (perf_counter() - begun), done / (process_time() - spent)))
    envs.close()
    by_clock, by_processors = np.median(rates, axis=0)
    return float(by_clock), float(by_processors)


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
            what = f"{name}, {threads} {'thread' if threads == 1 else 'threads'}"
            value = f"{wall / 1e6:.2f}, {cpu / 1e6:.2f} million"
            table.append((what, value, wanted if threads == cores else ""))
    table += [
        (
            "the same environment, 8 in Gymnasium's SyncVectorEnv",
            f"{gymnasiums('sync', 8) / 1e6:.4f} million",
            "",
        ),
        (
            "the same environment, 8 in Gymnasium's AsyncVectorEnv",
            f"{gymnasiums('async', 8) / 1e6:.4f} million",
            "",
        ),
    ]
    return table


def section() -> str:
    """Measure, and return the section of the page."""
    lines = [
        HEADING,
        "",
        f"`python -m benchmarks.environments` writes this section: steps of 5 ms of {LANES} robots, in a second by the "
        "clock and in a second of processor time, the medians of 60 spells. "
        f"{processor()}, {os.cpu_count()} cores, whose load by other work was {os.getloadavg()[0]:.1f} before.",
        "",
        "| | by the clock, processor time | target |",
        "|---|---:|---:|",
        *(f"| {name} | {value} | {wanted} |" for name, value, wanted in rows()),
        "",
        "Published by others:",
        "",
        "| | steps a second | on |",
        "|---|---:|---|",
        *(f"| {name} | {rate} | {machine} |" for name, rate, machine in PUBLISHED),
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    before = PAGE.read_text(encoding="utf-8").partition(HEADING)[0].rstrip("\n")
    write_text(PAGE, f"{before}\n\n{section()}")
    print(PAGE.read_text(encoding="utf-8").partition(HEADING)[2])

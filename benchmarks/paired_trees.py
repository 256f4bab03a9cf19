"""Two trees of the source, paired: steps a second of the batched engine, and its compilation from nothing.

    python benchmarks/paired_trees.py OLD NEW [--rounds 7] [--cold 2]
    python benchmarks/paired_trees.py OLD NEW --logs square1.csv square2.csv     an identification from these logs

Each round runs both trees one after the other, each in a process of its own, so that what else the machine does meets
both alike. The ratio of each round is new over old (of speeds: above 1 is faster; of times: below 1 is faster); the
median and the range over the rounds are printed.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

WORKER = """
import json, sys, time
begin = time.perf_counter()
import numpy as np
from ballbot import Model, Robot
from ballbot.robot import Friction
from ballbot.mechanics.engine import run as engine

friction = Friction(viscous=(.014, .016, .013), coulomb=(.11, .09, .12), stribeck=(.05, .04, .06), stribeck_speed=.6,
                    stribeck_exponent=1.1, rolling=.007)
model = Model(Robot.load("alten").replace(friction=friction))
rng = np.random.default_rng(0)
lanes, samples, steps = 1024, 20, 5


def run(initial, torques):
    tables = {"parameters": model.packed[None], "initial": initial, "torques": torques}
    indices = {"parameter_of": np.zeros(lanes, int)}
    options = {"sample_time": 5e-3, "steps": steps, "threads": 1}
    if hasattr(engine, "Lanes"):
        return engine.simulate_lanes(model.selected, engine.Lanes(**tables, **indices), **options)
    return engine.simulate_lanes(model.selected, **tables, **indices, **options)  # trees from before `Lanes`


moving = np.zeros((lanes, 10))
moving[:, 5:7] = rng.uniform(0.5, 1.0, (lanes, 2))
moving[:, 9] = 8.0
sticking = np.zeros((lanes, 10))
sticking[:, 2:4] = rng.normal(0.0, 0.01, (lanes, 2))
torques = rng.normal(0.0, 0.1, (lanes, samples, 3))
run(moving, 0.0 * torques)
first = time.perf_counter() - begin
found = {"first call": first}
for name, initial, u in (("smooth", moving, 0.0 * torques), ("stick-slip", sticking, torques)):
    best = 0.0
    for _ in range(12):
        start = time.process_time()
        out = run(initial, u)
        best = max(best, lanes * samples * steps / (time.process_time() - start))
    found[name] = best
    found[name + " result"] = float(np.nansum(out.states))
print(json.dumps(found))
"""

#: an identification of friction from the logs, in one thread, once more after the one that compiles
FIT = """
import json, sys, time
import ballbot
from ballbot.fitting.run import Run, Threads
from ballbot.identification import identify
from ballbot.identification.identify import IdentificationOptions

run = Run(seed=0, executor=Threads(count=1), progress=lambda _: None)
logs = [ballbot.Log.read(path) for path in sys.argv[1:]]
identify("alten", logs[:1], options=IdentificationOptions(most_steps=3), run=run)
clock, processor = time.perf_counter(), time.process_time()
found = identify("alten", logs, run=run)
print(json.dumps({"clock": time.perf_counter() - clock, "processor": time.process_time() - processor,
                  "cost": found.gauss_newton_cost[-1]}))
"""


def measured(
    tree: Path, cache: str | None = None, *, worker: str = WORKER, logs: Sequence[Path] = ()
) -> dict[str, float]:
    """Return what the worker prints in a tree, its compiled code kept in `cache`."""
    environment = {**os.environ, "PYTHONPATH": str(tree / "src")}
    if cache:
        environment["NUMBA_CACHE_DIR"] = cache
    done = subprocess.run(
        [sys.executable, "-c", worker, *(str(path.resolve()) for path in logs)],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        cwd=tree,
    )
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--cold", type=int, default=2)
    parser.add_argument("--logs", type=Path, nargs="+")
    asked = parser.parse_args()
    trees = (asked.old.resolve(), asked.new.resolve())
    if asked.logs:
        for name, tree in zip(("old", "new"), trees, strict=True):
            cost = measured(tree, worker=FIT, logs=asked.logs)
            print(
                f"identification, {name}: {cost['processor']:.1f} s of processor time, {cost['clock']:.1f} s by the "
                f"clock, cost {cost['cost']:.5f}"
            )
        return
    for tree in trees:
        measured(tree)  # compiled once
    speeds: dict[str, list[tuple[float, float]]] = {"smooth": [], "stick-slip": []}
    for k in range(asked.rounds):
        both = {tree: measured(tree) for tree in (trees if k % 2 == 0 else trees[::-1])}
        old, new = (both[tree] for tree in trees)
        for name in speeds:
            speeds[name].append((old[name], new[name]))
            if old[name + " result"] != new[name + " result"]:
                print(f"{name}: results differ, {old[name + ' result']!r} and {new[name + ' result']!r}")
    for name, pairs in speeds.items():
        _print(
            name,
            [new / old for old, new in pairs],
            max(old for old, _ in pairs),
            max(new for _, new in pairs),
        )
    cold = []
    for k in range(asked.cold):
        times = {}
        for tree in trees if k % 2 == 0 else trees[::-1]:
            with tempfile.TemporaryDirectory() as folder:
                times[tree] = measured(tree, folder)["first call"]
        cold.append((times[trees[0]], times[trees[1]]))
    if cold:
        _print(
            "cold", [new / old for old, new in cold], min(old for old, _ in cold), min(new for _, new in cold)
        )


def _print(name: str, ratios: list[float], old: float, new: float) -> None:
    low, high = min(ratios), max(ratios)
    print(
        f"{name}: ratio {statistics.median(ratios):.3f} ({low:.3f} to {high:.3f}), best old {old:.4g}, new {new:.4g}"
    )


if __name__ == "__main__":
    main()

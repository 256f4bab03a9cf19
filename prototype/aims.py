"""Measures of the prototype in the compiled loop beside the shaping, paired by seed."""

import sys
import warnings

warnings.filterwarnings("ignore")
from functools import partial

import numpy as np

from ballbot.control.presets.precise import precise_controller
from ballbot.control.references import sampled_reference
from ballbot.fitting.run import Threads
from ballbot.workflows.courses import choose_courses
from ballbot.workflows.grid import Condition, GridRun, run_grid
from ballbot.workflows.league import with_assumed_friction
from ballbot.workflows.metrics import score
from planner import Settings, governed, robot_numbers

KEYS = ("rms_position_error", "peak_position_error", "stopping_time", "stopping_distance", "overshoot",
        "rms_speed_error", "settling_time", "peak_lean", "rms_torque_change")


def compare(name, courses, seeds, st, plant="model", show=True):
    robot, assumed = with_assumed_friction(name)
    controller = precise_controller(robot)
    st = st(robot, controller) if callable(st) else st
    num = robot_numbers(robot, controller, st)
    out = {}
    for course in choose_courses(courses, robot, plant):
        if assumed:
            course = course.with_wheel_friction(robot.friction)
        raw = course.reference_spec.reference()
        t, rows, asked, ms, ws, aa = governed(raw, course.duration, num, st)
        small = (np.abs(rows[:, 2:4]).max(1) < 1e-6) & (np.abs(rows[:, 5:7]).max(1) < 1e-5)
        rows[small, 2:4] = rows[small, 5:] = 0.0
        made = {"shaping": course.reference_spec.reference, "planner": partial(sampled_reference, t, rows)}
        runs = []
        for kind, reference in made.items():
            for seed in seeds:
                runs.append(GridRun(candidate=kind, controller=controller, condition=Condition(
                    plant=course.plant(robot, seed=seed), reference=reference, duration=course.duration, seed=seed,
                    course=f"{course.name} {kind}", rules=course.rules)))

        def ask(run, log):
            k = np.clip(np.round(log.t / num["dt"]).astype(int), 0, len(asked) - 1)
            own = log.with_columns({"ref_x": asked[k, 0], "ref_y": asked[k, 1], "ref_psi": asked[k, 4]})
            return score(own, run.condition.rules)

        table = run_grid(runs, ask, workers=Threads(count=1))
        a, b = (table.of(kind) for kind in made)
        line = [f"{name} {course.name}: falls {sum(s.ended is not None for s in a)} {sum(s.ended is not None for s in b)}"]
        for key in KEYS:
            u, v = (np.array([getattr(s, key) if s.ended is None else np.nan for s in x]) for x in (a, b))
            if np.isfinite(u).any() and np.isfinite(v).any():
                d = v - u
                n = np.isfinite(d).sum()
                line.append(f"{key} {np.nanmean(u):.4g} -> {np.nanmean(v):.4g} (diff {np.nanmean(d):+.3g} +- {1.96 * np.nanstd(d, ddof=1) / np.sqrt(n):.2g})")
        out[course.name] = line
        if show:
            print("\n    ".join(line), flush=True)
    return out


if __name__ == "__main__":
    courses = sys.argv[2] if len(sys.argv) > 2 else "stop,velocity_steps,square,circle,figure_eight"
    compare(sys.argv[1], courses, range(1, 21), Settings(**eval(sys.argv[3] if len(sys.argv) > 3 else '{}')))

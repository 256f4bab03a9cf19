"""The part in the compiled loop beside the shaping, paired by seed: PRESET COURSES SEEDS MARGIN."""
import sys, warnings
warnings.filterwarnings("ignore")
from dataclasses import replace
import numpy as np
from ballbot.control.controller import grip_torque_limit
from ballbot.control.parts.planner import Planner
from ballbot.control.presets.precise import precise_controller
from ballbot.fitting.run import Threads
from ballbot.workflows.courses import choose_courses
from ballbot.workflows.league import run_league, with_assumed_friction

KEYS = ("rms_position_error", "peak_position_error", "stopping_time", "stopping_distance", "overshoot", "settling_time",
        "largest_impulse", "top_speed", "peak_heading_error", "peak_lean")


import os
import ballbot.control.parts.planner as P

_numbers = P.Planner.numbers
P.Planner.numbers = lambda self, settings: replace(
    (lambda n: replace(n, viscous=n.viscous))(_numbers(self, settings)),
    **eval(os.environ.get("MORE", "{}")))


def planned(robot, margin=0.1):
    c = precise_controller(robot)
    sh = c.parts.shaping
    limit = (1 - margin) * min(c.torque_limit, grip_torque_limit(robot))
    return c, c.with_parts(replace(c.parts, planner=Planner(torque_limit=limit, speed_limit=sh.speed_limit)))


if __name__ == "__main__":
    name, courses, seeds = sys.argv[1], sys.argv[2], range(1, 1 + int(sys.argv[3]))
    plant = sys.argv[5] if len(sys.argv) > 5 else "model"
    robot, assumed = with_assumed_friction(name)
    a, b = planned(robot, float(sys.argv[4]) if len(sys.argv) > 4 else 0.1)
    chosen = choose_courses(courses, robot, plant)
    if assumed:
        chosen = [one.with_wheel_friction(robot.friction) for one in chosen]
    for course in chosen:
        league = run_league(robot, {"shaping": a, "planner": b}, [course], seeds=seeds, workers=Threads(count=1))
        A, B = (league.scores[course.name, k] for k in ("shaping", "planner"))
        line = [f"{name} {course.name}: falls {sum(s.ended is not None for s in A)} {sum(s.ended is not None for s in B)}"]
        for key in KEYS:
            free = key in ("largest_impulse", "top_speed")
            u, v = (np.array([getattr(s, key) if free or s.ended is None else np.nan for s in x]) for x in (A, B))
            if np.isfinite(u).any() and np.isfinite(v).any():
                d = v - u
                line.append(f"{key} {np.nanmean(u):.4g} -> {np.nanmean(v):.4g} ({np.nanmean(d):+.3g} +- {1.96 * np.nanstd(d, ddof=1) / np.sqrt(len(d)):.2g})")
        print("\n    ".join(line), flush=True)

"""A planned fast move: its time, what it uses of each limit, and how a controller follows it."""

import numpy as np

from ballbot.report.blocks import Result, Sheet, section
from ballbot.report.series import Line, Panel, TimeSeries, wheel_lines
from ballbot.results import to_results
from ballbot.rounding import percent
from ballbot.summary import counted
from ballbot.workflows.metrics import lean_angle
from ballbot.workflows.plan import Followed, Plan


def plan_report(plan: Plan, followed: Followed | None = None, *, scenario: str = "") -> Result:
    """Return the page."""
    own = plan.limits
    limits = {
        "wheel torque [N m]": own.torque,
        "motor speed [rad/s]": plan.robot.drive.top_speed,
        "lean [deg]": np.degrees(own.lean),
        "speed [m/s]": own.speed,
        "wheel grip": own.grip,
        "floor grip": own.floor_grip,
        "pivoting [m]": own.pivot,
    }
    rows = [
        (
            heading,
            *((f"{limit:.3g}", percent(share)) if np.isfinite(limit) else ("-", "-")),
            f"{1e3 * saving:.1f}",
        )
        for (heading, limit), share, saving in zip(
            limits.items(), plan.used.max(axis=0).tolist(), plan.savings.values(), strict=True
        )
    ]
    headings = ("limit", "value", "used", "1 % more saves [ms]")
    caption = (
        "What the motion uses of each limit: of the motors' speed with their torque, of the grip with the reserve. "
        f"{percent(own.margin)} of each is left to the controller."
    )
    return Result(
        title=f"{plan.robot.name}: {plan.what}",
        lead="The fastest motion within the robot's limits and with its friction, from the exact equations of motion.",
        verdict=[("", sentence) for sentence in plan_sentences(plan, followed, scenario=scenario)],
        sections=[
            section("Limits", Sheet(headings, rows, caption)),
            section("The motion", plan_series(plan)),
        ],
        undecided=[
            "The grip of the real wheels on the real ball, and of the ball on the floor: it is an assumption.",
            "Whether the real robot follows: the simulations are not the robot. Begin with lower limits.",
        ],
        data=to_results(plan) | ({"followed": followed, "scenario": scenario} if followed else {}),
    )


def plan_sentences(plan: Plan, followed: Followed | None, *, scenario: str) -> list[str]:
    """Return what was found, the most important first."""
    text = f"{plan.what[0].upper()}{plan.what[1:]} takes {plan.duration:.3f} s over {plan.distance:.2f} m."
    saved = 1e3 * plan.savings[plan.bound]
    sentences = [
        f"{text} The {plan.bound} bounds it: one per cent more would save {saved:.0f} ms.",
        f"Its largest steady speed in this direction is {plan.top_speed:.2f} m/s, by the {plan.top_speed_bound}.",
    ]
    if plan.begins > 0.0:
        sentences.append(f"The stop begins {plan.begins:.2f} s after the start, at the end of the run-up.")
    if followed is None:
        return sentences
    fell = "none fell" if followed.fell == 0 else f"{followed.fell} fell"
    sentences.append(
        f"On {counted(followed.runs, 'simulated robot')} of the scenario {scenario} that followed it, {fell}; the "
        f"others were at most {1e3 * followed.peak_error:.0f} mm from it, and {1e3 * followed.end_error:.0f} mm two "
        "seconds after its end."
    )
    return sentences


def plan_series(plan: Plan) -> TimeSeries:
    """Return the motion over time."""
    x, y, theta, phi, psi = plan.states[:, :5].T
    speed = np.hypot(plan.states[:, 5], plan.states[:, 6])
    torque = plan.limits.torque
    return TimeSeries(
        plan.t,
        (
            Panel(
                "place [m, rad]",
                [Line("x [m]", x, "fifth"), Line("y [m]", y, "sixth"), Line("ψ [rad]", psi, "quiet")],
            ),
            Panel("speed [m/s]", [Line("speed", speed, "measured")], from_zero=True),
            Panel(
                "lean [deg]",
                [Line("lean", np.degrees(lean_angle(theta, phi)), "measured")],
                levels=(float(np.degrees(plan.limits.lean)),),
                from_zero=True,
            ),
            Panel("motors' torques [N m]", wheel_lines(list(plan.torques.T)), levels=(-torque, torque)),
        ),
        "The planned motion.",
        level="limit",
    )

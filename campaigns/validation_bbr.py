"""Is the model with friction better on logs that its friction was not found from? Ratios of errors, with intervals.

Each of the test robot's logs (`campaigns.section.data_folder`) is judged by friction found from others.
"""

from __future__ import annotations

from ballbot.identification import identify
from ballbot.log import STATE_NAMES
from ballbot.report.tables import digits
from ballbot.robot import Robot
from ballbot.validation import ErrorPair, Validation, findings, validate
from campaigns.identified_errors import TABLE_4_1, log_of
from campaigns.section import Section

#: the log judged, and those that its friction is from
JUDGED = {
    "square_soft": ("thesis_step_soft", "hold_soft"),
    "thesis_step_soft": ("square_soft", "hold_soft"),
    "hold_soft": ("square_soft", "thesis_step_soft"),
    "square_stiff": ("square_soft", "hold_soft"),
}


def campaign() -> Section:
    """Identify, validate and return the section of docs/generated/evidence.md."""
    robots: dict[tuple[str, ...], Robot] = {}
    for logs in JUDGED.values():
        if logs not in robots:
            robots[logs] = identify(Robot.load("alten"), [log_of(name) for name in logs], seed=0).robot
    validations = {name: validate(robots[logs], log_of(name)) for name, logs in JUDGED.items()}
    square = validations["square_soft"].closed_loop
    assert square is not None
    pairs = [square.restarted, *(_open_loop(one) for one in validations.values())]
    rows = []
    for place, state in enumerate(STATE_NAMES):
        with_friction, without = TABLE_4_1[state]
        cells = [f"{without / with_friction:.1f}", *(_cell(pair, place) for pair in pairs)]
        rows.append([state.replace("_", r"\_"), *cells])
    return Section(
        title="Friction judged on other logs",
        before="Error (4.1) of the model without friction over the one with it, and its 95 % interval from a bootstrap"
        " of blocks of runs; twelve parameters from the soft logs that are not judged, three quarters of their windows"
        " (for `square_stiff`, those of `thesis_step_soft`). Closed loop restarted every 4 s, open loop to a fall or"
        " 2 s, a start every second.",
        columns=[
            "state",
            "Table 4.1, closed loop",
            f"closed loop, `square_soft`, {square.restarted.runs} runs",
            *(f"open loop, `{name}`, {_open_loop(one).runs}" for name, one in validations.items()),
        ],
        rows=rows,
        after=_after(validations, square.restarted),
    )


def _open_loop(validation: Validation) -> ErrorPair:
    assert validation.open_loop is not None
    return validation.open_loop.errors


def _cell(pair: ErrorPair, place: int) -> str:
    lower, upper = pair.ratio_interval()[:, place]
    ratio = digits(pair.ratio[place])
    return f"{ratio} ({digits(lower)} to {digits(upper)})" if lower == lower else f"{ratio} (too few runs)"


def _after(validations: dict[str, Validation], closed: ErrorPair) -> str:
    """Return in how many states each interval is wholly above one, and what is said of the square's residuals."""
    counts = [f"in closed loop on the square in {closed.verdicts().count('better')} of ten states"]
    for name, one in validations.items():
        pair = _open_loop(one)
        if pair.ratio_interval()[0, 0] == pair.ratio_interval()[0, 0]:
            counts.append(f"in open loop on `{name}` in {pair.verdicts().count('better')}")
    said = "\n".join(f"- {one.text}" for one in findings(validations["square_soft"])).replace("_", r"\_")
    return (
        f"The interval is wholly above one {', '.join(counts)}. On `square_stiff` the robot fell after eight seconds, "
        "its motors chattering in their play (see [errors with identified friction](#errors-with-identified-friction-"
        f"over-those-without)); {_open_loop(validations['square_stiff']).runs} runs give no interval.\n\n"
        f"What `ballbot validate` says of `square_soft`:\n\n{said}"
    )

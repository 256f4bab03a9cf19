"""A learned controller: its learning curve, and how it does on robots that it was not trained on."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from ballbot.learning.learn import Confirmed, Learned
from ballbot.log import Log
from ballbot.report.blocks import Animation, Result, Sheet, section
from ballbot.report.series import Line, Panel, TimeSeries
from ballbot.results import to_results
from ballbot.rounding import digits
from ballbot.summary import counted
from ballbot.viewer.page import replay_part

_HEADINGS = ("controller", "on", "runs", "falls", "RMS position error [mm]", "RMS velocity error [m/s]")


def learning_report(
    learned: Learned, *, scenario: str = "", film: Mapping[str, Log] = MappingProxyType({})
) -> Result:
    """Return the page of a learned controller, with the runs of `ballbot.learning.learn.film`."""
    name = learned.controller.robot.name
    rows = [
        (who, run.plant, f"{run.runs}", f"{run.fell}", 1e3 * run.rms_position, run.rms_velocity)
        for who, runs in (("learned", learned.confirmed), (_linear(learned), learned.baseline_confirmed))
        for run in runs
    ]
    tried = "Fresh robots that are asked for the most that the task asks for, turn by turn"
    caption = (
        "The same robot from the same start, under the best policy after so many seconds of learning. A robot that "
        "falls stays where it fell. Drag to orbit."
    )
    return Result(
        title=f"{name}: {learned.task.name}, learned",
        lead="A network that learned on simulated robots what torques to give. Its rewards are those of the training, "
        "with the noise that it explores by; the runs afterwards are of other robots, without that noise.",
        verdict=[("", sentence) for sentence in learning_sentences(learned, scenario=scenario)],
        sections=[
            section("On other robots", Sheet(_HEADINGS, rows, tried, brief=range(5))),
            section("The learning curve", curve_series(learned)),
            section(
                "As it learned",
                Animation(replay_part(film, learned.controller.robot), caption) if film else None,
            ),
        ],
        undecided=[
            "Whether the real robot is like the simulated ones: try it with a person who catches the robot.",
            "Other tasks: a policy knows what it was trained for.",
        ],
        data={"robot": name} | to_results(learned) | ({"scenario": scenario} if scenario else {}),
    )


def learning_sentences(learned: Learned, *, scenario: str) -> list[str]:
    """Return what was learned, the most important first."""
    last = learned.curve[-1]
    of_scenario = f" of the scenario {scenario}" if scenario else ""
    early = " It was stopped early." if learned.stopped else ""
    sentences = []
    for own, other in zip(learned.confirmed, learned.baseline_confirmed, strict=True):
        falls = "never fell" if own.fell == 0 else f"fell {counted(own.fell, 'time')}"
        where = "physics-engine twin" if own.plant == "twin" else "loop"
        sentences.append(
            f"In {counted(own.runs, 'run')} of {own.duration:g} s on the {where} it {falls}; its RMS errors "
            f"are {_errors(own)}, those of the {_linear(learned)} {_errors(other)} ({counted(other.fell, 'fall')})."
        )
    sentences.append(
        f"It learned from {last.samples:,} samples{of_scenario} in {last.seconds:.0f} s.{early} The "
        f"reward was {last.reward:.2f} a second in the end, and {learned.baseline:.2f} of the {_linear(learned)}."
    )
    return sentences


def _linear(learned: Learned) -> str:
    return "controller alone" if learned.residual else "nominal LQR"


def _errors(tried: Confirmed) -> str:
    """Return the error that a task is about, in words."""
    return f"{digits(1e3 * tried.rms_position)} mm and {digits(tried.rms_velocity)} m/s"


def curve_series(learned: Learned) -> TimeSeries:
    """Return the learning curve by the clock."""
    seconds, rewards, lengths = np.array(
        [(point.seconds, point.reward, point.length) for point in learned.curve]
    ).T
    reward, length = Line("reward", rewards, "measured"), Line("length", lengths, "first")
    return TimeSeries(
        seconds,
        (
            Panel("reward a second", [reward], levels=(learned.baseline,), from_zero=True),
            Panel("length of the episodes that ended [s]", [length], from_zero=True),
        ),
        "The learning curve by the clock.",
        across="time of training [s]",
        level=f"the {_linear(learned)}",
    )

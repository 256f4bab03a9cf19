"""Whether the physics-engine twin agrees with the compiled loop on the controller that a study chose.

The loop has no slip and, with identified friction, no rollers. So the chosen controller and the soft gain run on the
twin too, on the first robots that were drawn, and stand beside the same course on the loop. The twin contradicts the
loop if a run falls there that falls nowhere on the loop, or if on the twin the other of the two is better.

The twins have the identified friction and rollers, play and noise of their own, whose losses the identified C_rr
already contains, so that errors on them are too large (the precise controller's peak error by 1.7 in ten logs of the
nominal twin, by the evidence of commit e54523c3). Only falls and the order of the two controllers are therefore taken
from the twin.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.progress import ignore_progress, in_stage
from ballbot.workflows.controller_choice import ControllerChoice, NamedCourse, Trial, run_trials

#: one side of the square, of which the last two seconds count
CONFIRMED_ON = NamedCourse(name="square", duration=8.0)
#: robots on which the twin runs
CONFIRMED_RUNS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Confirmation:
    """The chosen controller and the soft gain on the twin and on the loop."""

    course: NamedCourse
    on_loop: Mapping[str, Trial]  #: by candidate, on every robot drawn
    on_twin: Mapping[str, Trial]  #: on the first of them

    @property
    def contradiction(self) -> str | None:
        """What the twin contradicts, in a sentence; None if it does not."""
        for name, trial in self.on_twin.items():
            if trial.falls and not self.on_loop[name].falls:
                return (
                    f"On the physics-engine twin the candidate {name} fell in {trial.falls} of "
                    f"{len(trial.scores)} runs, and in none on the compiled loop: do not trust this choice."
                )
        names = list(self.on_twin)
        if len(names) == 2:
            soft, chosen = names
            loop, twin = (on[soft].ratio_to(on[chosen]) for on in (self.on_loop, self.on_twin))
            if twin.runs and loop.low > 1.0 > twin.high:
                return (
                    f"On the physics-engine twin the candidate {chosen} was worse than {soft} in every run, and better "
                    "on the compiled loop: do not trust this choice."
                )
        return None


def confirm(choice: ControllerChoice, *, run: Run = DEFAULT_RUN) -> Confirmation | None:
    """Run the chosen controller and the soft gain on the twin; None if every candidate fell.

    InputError if the twin cannot be made.
    """
    if choice.chosen is None:
        return None
    names = dict.fromkeys(("none", choice.chosen))
    asked = {name: choice.trials[name].controller for name in names}
    run = replace(run, progress=in_stage(run.progress, "confirming on the twin"))
    return Confirmation(
        course=CONFIRMED_ON,
        on_twin=run_trials(asked, CONFIRMED_ON, choice.plants[:CONFIRMED_RUNS], on_twin=True, run=run),
        on_loop=run_trials(asked, CONFIRMED_ON, choice.plants, run=replace(run, progress=ignore_progress)),
    )

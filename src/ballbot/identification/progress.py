"""What a long identification tells while it runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ballbot.pace import Pace


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far an identification has come."""

    stage: str  #: such as "evolution" or "polish"
    step: int  #: steps of the stage that are done
    of: int  #: how many there will be at most
    cost: float  #: the best cost so far; see `ballbot.identification.prediction.Cost`
    share: float  #: of all stages' work, 0 to 1, as if each took its most steps
    seconds_left: float | None  #: at most, at the pace of late; None where that is not known yet


Report = Callable[[Progress], None]


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A part of an identification."""

    name: str
    steps: int  #: at most
    work: float  #: of a step; in any unit, the same for all stages


class Teller:
    """Turns the steps of all stages into one share, which never falls.

    Parameters
    ----------
    report : callable, optional
        Told a `Progress` after each step.
    stages : sequence of Stage
        In their order.
    """

    def __init__(self, report: Report | None, stages: Sequence[Stage]) -> None:
        self._report, self._stages = report, tuple(stages)
        self._pace, self._share = Pace(), 0.0

    def of(self, name: str) -> Callable[[int, float], None]:
        """Return what the stage of that name tells its steps and costs to."""
        place = [stage.name for stage in self._stages].index(name)
        stage = self._stages[place]
        whole = sum(one.steps * one.work for one in self._stages)
        before = sum(one.steps * one.work for one in self._stages[:place])

        def tell(step: int, cost: float) -> None:
            self._share = max(self._share, (before + step * stage.work) / whole)
            left = self._pace.seconds_left(self._share)
            if self._report:
                self._report(
                    Progress(
                        stage=name,
                        step=step,
                        of=stage.steps,
                        cost=cost,
                        share=self._share,
                        seconds_left=left,
                    )
                )

        return tell

"""The work of `ballbot reproduce`: each figure and table in the thesis's order, then the mistakes."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ballbot.errors import InputError
from ballbot.progress import Progress, ProgressCallback
from ballbot.robot import Friction, Robot
from ballbot.thesis.reproduce.bench import Bench
from ballbot.thesis.reproduce.figures import ITEMS
from ballbot.thesis.reproduce.item import VERDICTS, Item, Mistake, Verdict
from ballbot.thesis.reproduce.mistakes import MISTAKES


@dataclass(frozen=True, kw_only=True, eq=False)
class Reproduction:
    """The reproduced thesis."""

    bench: Bench
    items: Mapping[str, Item]  #: by their names, "Figure 5.6"
    mistakes: tuple[Mistake, ...]  #: numbered from 1

    @property
    def friction(self) -> Friction | None:
        """The friction identified; None if no item needed it."""
        robot = vars(self.bench).get("identified")
        return robot.friction if isinstance(robot, Robot) else None

    @property
    def counts(self) -> dict[Verdict, int]:
        """How many items have each verdict that there is."""
        verdicts = Counter(item.verdict for item in self.items.values())
        return {verdict: verdicts[verdict] for verdict in VERDICTS if verdicts[verdict]}


def items_named(only: str | None) -> Mapping[str, Callable[[Bench], Item]]:
    """Return, of `ITEMS`, the figure or table of that name, or all.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if only is None:
        return ITEMS
    asked = " ".join(only.casefold().split())
    chosen = {name: make for name, make in ITEMS.items() if name.casefold() == asked}
    if not chosen:
        raise InputError(f"There is no {only!r} to reproduce; there are {', '.join(ITEMS)}.")
    return chosen


def reproduce(*, seed: int, only: str | None = None, progress: ProgressCallback) -> Reproduction:
    """Reproduce the figures and tables; equal seeds give equal results.

    Parameters
    ----------
    seed : int
        Random seed.
    only : str, optional
        A figure or table, such as "Table 4.1": that one alone, and of the recordings those that it needs.
    progress : callable
        Called with the progress.
    """
    chosen, mistaken = items_named(only), () if only else MISTAKES
    alten = Robot.load("alten")
    robot = alten.replace(friction=Friction.none(alten.wheel_count))
    bench = Bench(robot=robot, seed=seed, progress=progress)
    total = len(chosen) + len(mistaken)
    items, mistakes = {}, []
    for name, make in chosen.items():
        progress(Progress(stage=name, done=len(items), total=total))
        items[name] = make(bench)
    for done, make in enumerate(mistaken, start=len(chosen)):
        progress(Progress(stage="mistakes", done=done, total=total))
        mistakes.append(make(bench))
    return Reproduction(bench=bench, items=items, mistakes=tuple(mistakes))

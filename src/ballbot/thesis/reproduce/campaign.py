"""The work of `ballbot reproduce`: each figure and table in the thesis's order, then the mistakes."""

from collections import Counter
from collections.abc import Callable
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
    items: tuple[Item, ...]
    mistakes: tuple[Mistake, ...]

    @property
    def friction(self) -> Friction | None:
        """The friction identified; None if no item needed it."""
        robot = vars(self.bench).get("identified")
        return robot.friction if isinstance(robot, Robot) else None

    @property
    def counts(self) -> dict[Verdict, int]:
        """How many items have each verdict that there is."""
        verdicts = Counter(item.verdict for item in self.items)
        return {verdict: verdicts[verdict] for verdict in VERDICTS if verdicts[verdict]}


def item_name(make: Callable[[Bench], Item]) -> str:
    """Return the name of the item that a function of `ITEMS` makes: "Figure 5.6"."""
    kind, *number = make.__name__.split("_")
    return f"{kind.capitalize()} {'.'.join(number).upper()}"


def items_named(only: str | None) -> tuple[Callable[[Bench], Item], ...]:
    """Return the function that makes the figure or table of that name, or those of all.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if only is None:
        return ITEMS
    names = {item_name(make): make for make in ITEMS}
    chosen = {name.casefold(): make for name, make in names.items()}.get(" ".join(only.casefold().split()))
    if chosen is None:
        raise InputError(f"There is no {only!r} to reproduce; there are {', '.join(names)}.")
    return (chosen,)


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
    items, mistakes = [], []
    for done, make in enumerate(chosen):
        progress(Progress(stage=make.__name__.replace("_", " "), done=done, total=total))
        items.append(make(bench))
    for done, make in enumerate(mistaken, start=len(chosen)):
        progress(Progress(stage="mistakes", done=done, total=total))
        mistakes.append(make(bench))
    return Reproduction(bench=bench, items=tuple(items), mistakes=tuple(mistakes))

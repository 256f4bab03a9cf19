"""The ways of validating, in the order of a page: another is one file with its `Comparison`, and one row here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ballbot.validation.closed_loop import closed_loop
from ballbot.validation.horizons import compare_horizons
from ballbot.validation.models import Case, Comparison
from ballbot.validation.open_loop import open_loop
from ballbot.validation.residuals import predict


@dataclass(frozen=True, kw_only=True)
class Way:
    """A way of validating."""

    key: str  #: in results.json
    heading: str  #: of its section
    compare: Callable[[Case], Comparison | str]  #: what it finds, or why the log does not allow it
    undisturbed: bool = (
        False  #: whether it needs a log that only wheels and gravity move, and that shows something
    )

    @property
    def words(self) -> str:
        """In a sentence, and the code of its verdict."""
        return self.key.replace("_", "-")


WAYS = (
    Way(key="open_loop", heading="Open loop", compare=open_loop, undisturbed=True),
    Way(key="closed_loop", heading="Closed loop", compare=closed_loop, undisturbed=True),
    Way(key="horizon", heading="Error against horizon", compare=compare_horizons),
    Way(key="prediction", heading="Residuals of the next sample", compare=predict),
)

"""The validations in the order of a page. To add one, write a file with its `Comparison` and add a row here."""

from collections.abc import Callable
from dataclasses import dataclass

from ballbot.validation.closed_loop import closed_loop
from ballbot.validation.horizons import compare_horizons
from ballbot.validation.models import Case, Comparison
from ballbot.validation.open_loop import open_loop
from ballbot.validation.residuals import predict


@dataclass(frozen=True, kw_only=True)
class ValidationKind:
    """A kind of validation."""

    key: str  #: in results.json
    heading: str  #: of its section
    compare: Callable[[Case], Comparison | str]  #: its result, or why the log does not allow it
    code: str  #: code of its verdict, in `ballbot.findings.CODES`
    as_logged: bool = (
        False  #: whether it simulates rollers; else the log is as of wheels that touch in a point
    )
    undisturbed: bool = False  #: whether it needs a log without external disturbances


VALIDATIONS = (
    ValidationKind(
        key="open_loop", heading="Open loop", compare=open_loop, code="open-loop", undisturbed=True
    ),
    ValidationKind(
        key="closed_loop",
        heading="Closed loop",
        compare=closed_loop,
        code="closed-loop",
        as_logged=True,
        undisturbed=True,
    ),
    ValidationKind(key="horizon", heading="Error against horizon", compare=compare_horizons, code="horizon"),
    ValidationKind(
        key="prediction", heading="Residuals of the next sample", compare=predict, code="residuals"
    ),
)

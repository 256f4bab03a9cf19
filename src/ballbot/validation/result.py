"""The result of a validation: the comparisons, the findings, and the contents of results.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ballbot.findings import Finding, by_severity, note, warning
from ballbot.summary import Reported
from ballbot.validation.closed_loop import ClosedLoop
from ballbot.validation.horizons import Horizons
from ballbot.validation.models import C, Comparison, ModelPair
from ballbot.validation.open_loop import OpenLoop
from ballbot.validation.residuals import Prediction
from ballbot.validation.ways import VALIDATIONS


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Validation(Reported):
    """How well two models predict a log; by default a robot's model with its friction and without any.

    `plot()` shows how the errors grow with the horizon of a prediction.
    """

    models: ModelPair
    comparisons: Mapping[str, Comparison]  #: by the keys of `VALIDATIONS`; only those that the log allows
    refused: Mapping[str, str]  #: by the keys of the others, why the log does not allow them
    duration: float  #: of the stretches compared [s]
    log_findings: tuple[Finding, ...] = ()  #: of the checks of the log
    no_evidence: str | None = None  #: why the logs cannot show which model is better, if they cannot
    left_out: tuple[str, ...] = ()  #: the reasons why logs were left out of the comparison

    def get(self, kind: type[C]) -> C | None:
        """Return the comparison of a class; None if the log does not allow it."""
        return next((found for found in self.comparisons.values() if isinstance(found, kind)), None)

    @property
    def open_loop(self) -> OpenLoop | None:
        """Errors in open loop; None if the log does not allow it."""
        return self.get(OpenLoop)

    @property
    def closed_loop(self) -> ClosedLoop | None:
        """Errors in closed loop; None if the log does not allow it."""
        return self.get(ClosedLoop)

    @property
    def horizon(self) -> Horizons:
        """Errors against the horizon of a prediction."""
        comparison = self.get(Horizons)
        assert comparison is not None  # every log allows it
        return comparison

    @property
    def prediction(self) -> Prediction:
        """Residuals of the next sample."""
        comparison = self.get(Prediction)
        assert comparison is not None  # every log allows it
        return comparison

    def verdicts(self) -> dict[str, str]:
        """Return each validation's verdict by its key, or the reason why the log does not allow it."""
        words = {way.key: f"No {way.code} validation: {self.refused.get(way.key)}" for way in VALIDATIONS}
        return words | {key: comparison.verdict() for key, comparison in self.comparisons.items()}

    def results(self) -> dict[str, object]:
        """Return the models and the results of each validation for results.json, numbers by the models' names."""
        closed = self.closed_loop
        return {
            "models": [
                {"name": name, "robot": model.robot.name, "formulation": model.formulation}
                for name, model in zip(self.models.names, self.models.both, strict=True)
            ],
            "findings": by_severity(findings(self)),
            "duration": self.duration,
            **dict.fromkeys(way.key for way in VALIDATIONS),
            **{key: comparison.results() for key, comparison in self.comparisons.items()},
            **{f"no_{way.key}": self.refused.get(way.key) for way in VALIDATIONS if way.undisturbed},
            "recovered_gain": closed and closed.recovered,
        }


def findings(validation: Validation) -> tuple[Finding, ...]:
    """Return the findings, the verdict first, those on the residuals last."""
    if validation.no_evidence is not None:
        return (warning("no-evidence", validation.no_evidence),)
    in_order, verdicts = [], validation.verdicts()
    for way in VALIDATIONS:
        in_order += [note(way.code, verdicts[way.key])] if verdicts[way.key] else []
        if way.key in validation.comparisons:
            in_order += validation.comparisons[way.key].remarks()
    left_out = [warning("no-evidence", sentence) for sentence in validation.left_out]
    return (*in_order[:1], *left_out, *in_order[1:])

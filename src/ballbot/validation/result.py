"""The result of a validation: the comparisons, the findings, and the contents of results.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ballbot.findings import Finding, by_severity, note, warning
from ballbot.results import reported
from ballbot.summary import Reported
from ballbot.validation.closed_loop import ClosedLoop
from ballbot.validation.horizons import Horizons
from ballbot.validation.models import C, Comparison, ModelPair, least_of
from ballbot.validation.open_loop import OpenLoop
from ballbot.validation.residuals import Prediction
from ballbot.validation.ways import VALIDATIONS


@dataclass(frozen=True, kw_only=True)
class Adequacy:
    """Whether whole logs, and predictions over a horizon, may be those of the first model."""

    over: float  #: of the whole logs [s]
    numbers: int  #: RMS, amplitude and period of their states; none without a controller of Ballbot
    inside: int  #: those within the 95 % range of the model's runs
    least: int  #: the 5 % quantile of `inside` over these runs, one of each log, each left out in turn
    up_to: float  #: [s]; see `Horizons.adequate_up_to`

    @reported
    def sentence(self) -> str:
        """The verdict on both."""
        horizon = f"adequate up to {self.up_to:.2g} s" if self.up_to else "rejected at every horizon"
        if not self.numbers:
            return f"Predicted from measured states, the model is {horizon}; whole logs were not compared."
        whole = "rejected" if self.inside < self.least else "adequate"
        return (
            f"The model is {whole} over {self.over:.3g} s in closed loop: inside in {self.inside} of {self.numbers}, "
            f"{self.least} or more in 95 % of its own runs. Predicted from measured states, it is {horizon}."
        )


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

    @property
    def adequacy(self) -> Adequacy:
        """Whether the first model may have made the logs, and up to which horizon."""
        whole = self.closed_loop.whole if self.closed_loop else ()
        # the noise of every log is drawn from the same seed
        own = [np.roll(comparison.own_inside, k) for k, comparison in enumerate(whole)]
        return Adequacy(
            over=sum(comparison.duration for comparison in whole),
            numbers=sum(comparison.measured.size for comparison in whole),
            inside=sum(int((comparison.sides[0] == 0).sum()) for comparison in whole),
            least=least_of(np.sum(own, axis=0)) if own else 0,
            up_to=self.horizon.adequate_up_to,
        )

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
            "adequacy": None if self.no_evidence else self.adequacy,
            **dict.fromkeys(way.key for way in VALIDATIONS),
            **{key: comparison.results() for key, comparison in self.comparisons.items()},
            **{f"no_{way.key}": self.refused.get(way.key) for way in VALIDATIONS if way.undisturbed},
            "recovered_gain": closed and closed.recovered,
        }


def findings(validation: Validation) -> tuple[Finding, ...]:
    """Return the findings: adequacy first, then which model is better, those on the residuals last."""
    if validation.no_evidence is not None:
        return (warning("no-evidence", validation.no_evidence),)
    verdicts = validation.verdicts()
    in_order = [note("adequacy", validation.adequacy.sentence)]
    for way in VALIDATIONS:
        in_order += [note(way.code, verdicts[way.key])] if verdicts[way.key] else []
        if way.key in validation.comparisons:
            in_order += validation.comparisons[way.key].remarks()
    left_out = [warning("no-evidence", sentence) for sentence in validation.left_out]
    return (*in_order[:2], *left_out, *in_order[2:])

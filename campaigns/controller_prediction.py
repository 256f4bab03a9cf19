"""Test a study's prediction of its controller on robots with faults that the study did not contain.

.venv/bin/python -m campaigns.evidence prediction
.venv/bin/python -m campaigns.controller_prediction        the constants, from the development set

The study is of the nominal twin. Each faulty twin (`campaigns.faulty_twins`) runs the square once with the precise
controller, whose log is evaluated, and once without compensation, for the true verdict. The constants of
`ballbot.workflows.controller_prediction` come from the development set, which has other seeds. Logs are kept in
build/controller_prediction: an interrupted campaign continues.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.log import Log
from ballbot.workflows.controller_prediction import (
    SHOWN,
    ControllerPrediction,
    ControllerVerdict,
    QuantityResult,
    evaluate_log,
    lognormal_interval,
    predict,
)
from ballbot.workflows.metrics import QUANTITIES, LogScore
from campaigns.faulty_twins import CONTROLLERS, KINDS, FaultyTwin, Studied, drawn, recorded, studied
from campaigns.section import Section, share_words

#: seeds of twins that the constants are made from, and of those that are judged
DEVELOPMENT, JUDGED = range(1000, 1076), range(2000, 2050)


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """A faulty twin, the verdict on its log, and what is true."""

    twin: FaultyTwin
    verdict: ControllerVerdict
    seen: LogScore  #: with the precise controller
    fell: bool
    without: LogScore  #: without compensation
    without_fell: bool

    @property
    def good(self) -> bool:
        """Whether the controller is better than none on this twin, and does not fall."""
        return not self.fell and (self.without_fell or self.seen.peak_error < self.without.peak_error)


def prediction_of(study: Studied) -> ControllerPrediction:
    """Return the study's prediction of the precise controller."""
    made = predict(replace(study.choice, chosen="precise"))
    assert made is not None
    return made


def outcomes(seeds: Sequence[int], *, of: str) -> list[Outcome]:
    """Return the outcomes of the twins of seeds, whose logs are kept in the folder of that name."""
    study, twins = studied(), [drawn(seed) for seed in seeds]
    prediction = prediction_of(study)
    return [
        _outcome(study, prediction, twin, logs)
        for twin, logs in zip(twins, recorded(twins, of=of), strict=True)
    ]


def _outcome(
    study: Studied, prediction: ControllerPrediction, twin: FaultyTwin, logs: dict[str, Log]
) -> Outcome:
    controller = study.controllers["precise"]
    log, without = logs["precise"], logs["none"]
    return Outcome(
        twin=twin,
        verdict=evaluate_log(prediction, log, controller),
        seen=LogScore.of(log, torque_limit=controller.torque_limit),
        fell=log.ended is not None,
        without=LogScore.of(without, torque_limit=study.controllers["none"].torque_limit),
        without_fell=without.ended is not None,
    )


def campaign() -> Section:
    """Judge the fifty twins and return the section of docs/generated/evidence.md."""
    return section(outcomes(JUDGED, of="judged"))


def section(outcomes: Sequence[Outcome]) -> Section:
    """Return the section of the page that the judged twins make."""
    stood = [case for case in outcomes if not case.fell]
    inside = [sum(_quantity(case, name).place == "inside" for case in stood) for name in QUANTITIES]
    rows = [
        _row(SHOWN[name].words, count, len(stood), _outside(stood, name), _ratios(stood, name))
        for name, count in zip(QUANTITIES, inside, strict=True)
    ]
    every = sum(quantity.place == "inside" for each in outcomes for quantity in each.verdict.quantities)
    rows += [
        _row("all", sum(inside), len(QUANTITIES) * len(stood)),
        _row("all, with the runs that ended early", every, len(QUANTITIES) * len(outcomes)),
    ]
    return Section(
        title="A study's prediction of its controller on robots with unknown faults",
        before=f"One study of the nominal twin predicts the precise controller's square (32 s) from 20 perturbed"
        f" plants; {len(outcomes)} twins with faults that the study did not contain ({len(KINDS)} kinds, mild to"
        " severe, half of them with a second, mild fault) run it once each. The model discrepancy was chosen on"
        f" {len(DEVELOPMENT)} other faulty twins. The interval of the fraction of all quantities treats them as"
        " independent, which those of one run are not. Errors are those "
        "of the logged state, as measured by the robot itself.",
        columns=["quantity", "inside its 95 % interval", "share", "better, worse", "measured over predicted"],
        rows=rows,
        after=_verdict_words(outcomes),
    )


def _row(name: str, count: int, runs: int, outside: str = "", ratios: str = "") -> list[str]:
    return [name, f"{count} of {runs}", share_words(count, runs), outside, ratios]


def _outside(outcomes: Sequence[Outcome], name: str) -> str:
    results = [_quantity(case, name) for case in outcomes if _quantity(case, name).place != "inside"]
    worse = sum(result.worse for result in results)
    return f"{len(results) - worse}, {worse}"


def _verdict_words(outcomes: Sequence[Outcome]) -> str:
    bad = [case for case in outcomes if not case.good]
    good = [case for case in outcomes if case.good]
    reverted = [case for case in bad if case.verdict.recommendation == "revert"]
    wrong = [case for case in good if case.verdict.recommendation == "revert"]
    counts = {
        name: sum(case.verdict.recommendation == name for case in outcomes)
        for name in ("keep", "weaken", "revert")
    }
    kinds = ", ".join(f"{case.twin.kind} (seed {case.twin.seed})" for case in bad) or "none"
    return (
        f"Verdicts: {', '.join(f'{count} {name}' for name, count in counts.items())}."
        f" {len(bad)} controllers fall ({sum(case.fell for case in bad)}) or have a larger peak error than none on the"
        f" same twin ({sum(not case.fell for case in bad)}): {kinds}; {len(reverted)} of them get `revert`. Of the"
        f" {len(good)} good ones {len(wrong)} do ({share_words(len(wrong), len(good))}){_named(wrong)}."
    )


def _named(wrong: Sequence[Outcome]) -> str:
    """Return which good controllers are wrongly reverted, and how good they are."""
    words = [
        f"{case.twin.kind} (seed {case.twin.seed}), peak error {case.seen.peak_error:.2f} m and without compensation"
        f" {case.without.peak_error:.2f} m"
        for case in wrong
    ]
    return f": {'; '.join(words)}" if words else ""


def _quantity(case: Outcome, name: str) -> QuantityResult:
    return next(each for each in case.verdict.quantities if each.name == name)


def _ratios(outcomes: Sequence[Outcome], name: str) -> str:
    pairs = [(part.value, part.predicted.median) for each in outcomes for part in [_quantity(each, name)]]
    ratios = [_used(name, value) / _used(name, median) for value, median in pairs]
    low, middle, high = np.quantile(ratios, (0.0, 0.5, 1.0))
    return f"{low:.2f} to {high:.2f}, median {middle:.2f}"


def _used(name: str, value: float) -> float:
    return 1.0 - value if name == "torque_margin" else value


def calibrate() -> None:
    """Print the constants that the development set gives."""
    study = studied()
    logs = recorded([drawn(seed) for seed in DEVELOPMENT], of="development")
    for controller in CONTROLLERS:
        of_controller = [run[controller] for run in logs]
        _print_discrepancy(study, controller, [log for log in of_controller if log.ended is None])


def _print_discrepancy(study: Studied, controller: str, logs: Sequence[Log]) -> None:
    seen = [LogScore.of(log, torque_limit=study.controllers[controller].torque_limit) for log in logs]
    drawn_runs = study.choice.trials[controller].performances
    print(f"{controller}, {len(logs)} runs that did not end early:")
    for name in QUANTITIES:
        actual, predicted = (
            np.array([_used(name, getattr(run, name)) for run in runs]) for runs in (seen, drawn_runs)
        )
        low, high = discrepancy(predicted, actual)
        print(f'    "{name}": ({low:.2g}, {high:.2g}),')


def discrepancy(predicted: NDArray[np.float64], actual: NDArray[np.float64]) -> tuple[float, float]:
    """Return the factors (lower, upper) with which an interval of the predicted values holds 95 % of the actual ones.

    Split conformal: on each side the score of rank ceil(0.975 (n + 1)), the largest if there are too few, less what
    the spread of the predicted values covers.
    """
    plain = lognormal_interval(predicted)
    ratios = np.sort(np.log(np.maximum(actual, 1e-9) / plain.median))
    rank = min(int(np.ceil(0.975 * (len(ratios) + 1))), len(ratios))
    up, down = ratios[rank - 1], -ratios[len(ratios) - rank]
    already_up, already_down = np.log(plain.high / plain.median), np.log(plain.median / plain.low)
    return (
        float(np.exp(-np.sqrt(max(down * abs(down) - already_down**2, 0.0)))),
        float(np.exp(np.sqrt(max(up * abs(up) - already_up**2, 0.0)))),
    )


if __name__ == "__main__":
    calibrate()

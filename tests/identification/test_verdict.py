"""Whether an identification is usable: from errors on windows held out, the ends of ranges, and the logs' agreement."""

import numpy as np
import pytest

from ballbot.identification.result import Verdict, verdict_of
from ballbot.identification.windows import Span

LEAN = np.array([False, True, True, False])


def judged(ratios: list[float], *, other_log: float | None = None, **more: list[str]) -> Verdict:
    """Return the verdict on 40 windows of a log whose errors with friction are so many times those without."""
    random = np.random.default_rng(3)
    without = random.gamma(4.0, size=(40, 4))
    # windows differ by a tenth in what friction does
    squares = without * np.square(ratios) * random.uniform(0.9, 1.1, size=(40, 4))
    of_log = np.zeros(40, dtype=int)
    if other_log is not None:
        of_log[32:] = 1
        squares[32:] = without[32:] * other_log**2
    spans = [Span(log=int(log), start=0.25 * i, end=0.25 * i + 0.25) for i, log in enumerate(of_log)]
    return verdict_of(squares, without, spans, lean=LEAN, **more)


def test_friction_that_halves_every_error_is_usable() -> None:
    found = judged([0.5] * 4)
    assert found.usable
    assert found.sentence.startswith("Usable: on 40 windows that the fit did not see, the error")
    assert found.gain.share == pytest.approx(0.5, abs=0.02)  # a tenth over 40 windows and 4 states


@pytest.mark.parametrize(
    ("ratios", "more", "reason"),
    [
        ([1.0] * 4, {}, "the prediction is no better with friction than without"),
        ([1.3] * 4, {}, "the prediction is no better with friction than without"),
        # as of one public log: the ball rolls as predicted, the lean does not
        ([0.65, 1.12, 1.09, 0.7], {}, "the lean is predicted no better with friction than without"),
        ([0.4] * 4, {"other_log": 1.1}, "the logs disagree: log 2"),
        ([0.5] * 4, {"at_end": ["b1", "b3"]}, "b1 and b3 are at the end of the usual range"),
        ([0.5] * 4, {"disagree": ["c1"]}, "the logs disagree on c1"),
    ],
)
def test_it_is_not_usable_for_each_reason(ratios, more, reason) -> None:
    found = judged(ratios, **more)
    assert not found.usable
    assert found.sentence.startswith("Not usable: ")
    assert len(found.reasons) == 1
    assert reason in found.reasons[0]

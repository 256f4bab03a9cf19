"""Logs of the same run: copies, parts and shifted copies are found, other runs are not."""

import numpy as np
import pytest

from ballbot import InputError
from ballbot.log import Log
from ballbot.log.columns import STATE_NAMES
from ballbot.log.fingerprints import fingerprint, logs_among, refuse_copies

NAMES = (*STATE_NAMES, "u1", "u2", "u3")


def run(seed: int, *, rows: int = 1000, decimals: int = 6) -> Log:
    """Return a log of noise about the motion that all runs have."""
    random, t = np.random.default_rng(seed), 0.005 * np.arange(rows)
    columns = {name: np.sin(t + i) + 0.1 * random.standard_normal(rows) for i, name in enumerate(NAMES)}
    return Log({"t": t, **{name: np.round(0.05 * values, decimals) for name, values in columns.items()}})


def changed(log: Log, rows: slice, shift: float = 0.0, later: float = 0.0) -> Log:
    return Log({name: log[name][rows] + (later if name == "t" else shift) for name in log.names})


@pytest.mark.parametrize(
    "copy",
    [
        lambda log: changed(log, slice(None)),
        lambda log: changed(log, slice(None), shift=1e-7),
        lambda log: changed(log, slice(None), later=1e-7),
        lambda log: changed(log, slice(600, None)),  # an overlap
        lambda log: changed(log, slice(0, 300), later=30.0),
    ],
    ids=["bytes", "values", "time", "end", "beginning"],
)
def test_a_copy_is_no_second_log(copy) -> None:
    log, other = run(1), run(2)
    with pytest.raises(InputError, match=r"second is of the same run as first: \d+ of its rows are the same"):
        refuse_copies({"first": log, "other": other, "second": copy(log)})
    logs = {"other": other, "same": changed(log, slice(None), later=5.0)}
    assert logs_among(logs, fingerprint(log)) == ["same"]


@pytest.mark.parametrize("decimals", [3, 6])
def test_other_runs_and_robots_at_rest_are_second_logs(decimals: int) -> None:
    runs = {str(seed): run(seed, decimals=decimals) for seed in range(4)}
    refuse_copies(runs)
    rest = Log({"t": run(0).t, **{name: np.zeros(1000) for name in NAMES}})
    refuse_copies({"one": rest, "other": rest})
    assert fingerprint(rest) == ()

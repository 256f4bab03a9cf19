"""Logs as pandas' tables and back, against pandas itself."""

import numpy as np
import pandas
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.columns import KNOWN_NAMES, unit_of
from ballbot.log.mapping import parse_mapping
from tests.support.log_examples import any_logs, smooth_log

LOG = smooth_log(rows=20)


@given(log=any_logs(st.sampled_from([*KNOWN_NAMES[1:], "battery", "Zustand 1"])))
@settings(max_examples=50)
def test_log_comes_back_to_the_bit(log):
    back = Log.from_pandas(log.to_pandas())
    assert set(back.names) == set(log.names)
    for name in log.names:
        np.testing.assert_array_equal(back[name], log[name])


def test_frame_has_time_as_index_and_units():
    frame = LOG.to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    assert frame.index.name == "t"
    np.testing.assert_array_equal(frame.index, LOG.t)
    assert frame.attrs["units"] == {name: unit_of(name) for name in LOG.names}
    assert frame["theta"].loc[0.01:0.02].tolist() == LOG["theta"][2:5].tolist()
    frame["theta"] = 0.0  # a copy: the log stays as it is
    assert LOG["theta"].any()


def test_dates_count_from_the_first_and_durations_from_zero():
    durations = pandas.to_timedelta([1.0, 1.005, 1.011], unit="s")
    for index, first in ((durations, 1.0), (pandas.Timestamp("2026-11-22 09:00+01:00") + durations, 0.0)):
        log = Log.from_pandas(pandas.DataFrame({"x": [1.0, 2.0, 3.0]}, index=index))
        # a nanosecond is what pandas counts in
        np.testing.assert_allclose(log.t - first, [0.0, 0.005, 0.011], rtol=0, atol=2e-9)


def test_missing_values_of_every_kind_become_nan():
    frame = pandas.DataFrame(
        {
            "t": [0.0, 1.0, 2.0],
            "x": pandas.array([1, None, 3], dtype="Int64"),
            "y": pandas.array([None, 2.5, 1.0], dtype="Float64"),
            "fallen": [False, True, True],
        }
    )
    log = Log.from_pandas(frame)
    np.testing.assert_array_equal(log["x"], [1.0, np.nan, 3.0])
    np.testing.assert_array_equal(log["y"], [np.nan, 2.5, 1.0])
    assert log["fallen"].tolist() == [0.0, 1.0, 1.0]


def test_foreign_frame_is_read_by_a_mapping():
    text = '[columns]\nt = { from = "time", unit = "ms" }\ntheta = { from = "roll", sign = -1 }\n'
    mapping = parse_mapping(text, source="mine")
    frame = pandas.DataFrame({"time": [0, 5, 10], "roll": [0.1, 0.2, 0.3]})
    for given_as in (frame, frame.set_index("time")):
        log = Log.from_pandas(given_as, mapping=mapping)
        assert log.t.tolist() == [0.0, 0.005, 0.01]
        assert log["theta"].tolist() == [-0.1, -0.2, -0.3]


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda _: {"t": [0.0]}, "an object of type dict is given"),
        (lambda pd: pd.DataFrame({"time": [0.0], "x": [1.0]}), "no time.*Its columns are: time, x"),
        (lambda pd: pd.DataFrame({"t": [0.0], "label": ["a"]}), r"'label' does not contain .*frame.drop"),
        (lambda pd: pd.DataFrame([[0.0, 1.0]], columns=["t", 1]), "a text that no other has"),
        (lambda pd: pd.DataFrame({"t": [0.0, 0.0]}), "Time does not increase"),
    ],
)
def test_what_makes_no_log_is_refused(make, sentence):
    with pytest.raises(InputError, match=sentence):
        Log.from_pandas(make(pandas))

"""What crosses between the page and the process of a live simulation."""

import json
from functools import reduce
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.errors import InputError
from ballbot.viewer.live import LivePush, Settings
from ballbot.viewer.live_process import Frames, Request, Status, merged, read_request

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
CHANGES = st.fixed_dictionaries(
    {},
    optional={
        "paused": st.booleans(),
        "pace": st.floats(0.05, 1.0),
        "compensation": st.sampled_from(["own", "none", "full", "partial"]),
        "friction": st.floats(0.0, 4.0),
        "slope_x": st.floats(-0.1, 0.1),
        "x": st.floats(-20.0, 20.0),
    },
)


@given(st.text(max_size=200) | JSON.map(json.dumps))
def test_any_text_is_a_request_or_refused(text):
    try:
        request = read_request(text)
    except InputError:
        return
    assert isinstance(request, Request)


@settings(max_examples=40)
@given(JSON)
def test_change_is_in_its_range_or_refused(value):
    for name in ("friction", "pace", "x", "motion", "paused", "mass"):
        try:
            request = read_request(json.dumps({"change": {name: value}}))
        except InputError:
            continue
        found = Settings().changed(dict(request.change or {}))
        assert 0.0 <= found.friction <= 4.0
        assert 0.05 <= found.pace <= 1.0
        assert abs(found.x) <= 20.0
        assert isinstance(found.paused, bool)
        assert name != "mass"


@given(CHANGES, st.floats(-50.0, 50.0), st.floats(-1.0, 10.0))
def test_request_of_the_page_is_read_as_it_was_meant(change, force, height):
    push = {"force": [force, -force], "height": height, "duration": 0.1, "robot": 0}
    found = read_request(json.dumps({"change": change, "push": push}))
    assert found.push == LivePush(force=(force, -force), height=height, duration=0.1, robot=0)
    assert Settings().changed(dict(found.change or {})) == Settings().changed(change)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"fricton": 1.0}, "did you mean 'friction'"),
        ({"friction": -1.0}, "friction"),
        ({"motion": "jump"}, "motion"),
        ({"paused": "yes"}, "true or false"),
    ],
)
def test_refusal_names_the_setting(change, sentence):
    with pytest.raises(InputError, match=sentence):
        read_request(json.dumps({"change": change}))


@given(st.lists(CHANGES.map(lambda one: Request(change=one)) | st.just(Request(reset=True)), max_size=6))
def test_merged_changes_come_to_the_same(requests):
    def between_resets(several):
        """Return the settings that each reset finds, and the last ones."""

        def take(found, one):
            return [*found, found[-1]] if one.reset else [*found[:-1], found[-1] | (one.change or {})]

        return reduce(take, several, [{}])

    found = merged(requests)
    assert between_resets(found) == between_resets(requests)
    assert all(a.reset or b.reset for a, b in pairwise(found))


def test_status_is_json_with_the_settings():
    tree = json.loads(Status(phase="running", settings=Settings(), ended=(None, "fallen")).text())
    assert tree["phase"] == "running"
    assert tree["settings"]["friction"] == 1.0
    assert tree["ended"] == [None, "fallen"]


def test_frames_are_those_after_the_last_one_seen():
    frames = Frames(2)
    assert frames.after(0) == (b"", 0)
    for number in (1.0, 2.0, 3.0):
        frames.write([number, -number])
    rows, newest = frames.after(1)
    np.testing.assert_array_equal(np.frombuffer(rows, dtype="<f4"), [2.0, -2.0, 3.0, -3.0])
    assert newest == 3
    assert frames.after(3) == (b"", 3)


def test_late_view_gets_the_newest_frames_only():
    frames = Frames(1)
    for number in range(1, 501):
        frames.write([float(number)])
    rows, newest = frames.after(0)
    found = np.frombuffer(rows, dtype="<f4")
    assert newest == 500
    assert found[-1] == 500.0
    assert len(found) <= 64
    np.testing.assert_array_equal(np.diff(found), 1.0)

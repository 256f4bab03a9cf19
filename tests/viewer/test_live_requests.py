"""What a page may ask of a live simulation."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.errors import InputError
from ballbot.viewer.live import LivePush, Request, Settings, read_request

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


@given(CHANGES, st.floats(-50.0, 50.0), st.floats(-1.0, 10.0))
def test_request_of_the_page_is_read_as_it_was_meant(change, force, height):
    push = {"force": [force, -force], "height": height, "duration": 0.1, "robot": 0}
    found = read_request(json.dumps({"change": change, "push": push}))
    assert found.push == LivePush(force=(force, -force), height=height, duration=0.1, robot=0)
    assert Settings().changed(dict(found.change or {})) == Settings().changed(change)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('{"change": {"fricton": 1.0}}', "did you mean 'friction'"),
        *((f'{{"change": {{"friction": {value}}}}}', "friction") for value in ("-1.0", "1e9", "NaN")),
        ('{"change": {"motion": "jump"}}', "motion"),
        ('{"change": {"paused": "yes"}}', "true or false"),
        ('{"push": {"force": [1, 2, 3], "height": 0.1}}', "force"),
        ('{"arm": true}', "arm"),
        ('{"reset": 1}', "reset"),
    ],
)
def test_refusal_names_the_setting(text, sentence):
    with pytest.raises(InputError, match=sentence):
        read_request(text)

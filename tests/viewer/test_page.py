"""The replay as HTML: packing, what the page may do, sizes, names of others' making."""

import base64
import hashlib
import json
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.errors import InputError
from ballbot.robot import Robot
from ballbot.viewer import replay_page
from ballbot.viewer.packing import packed
from ballbot.viewer.page import plot_script
from tests.support.log_examples import smooth_log
from tests.support.packing import unpacked

ALTEN = Robot.load("alten")


def data_of(page: str):
    (text,) = re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', page, flags=re.DOTALL)
    return json.loads(text)


@given(
    st.lists(st.floats(-1e6, 1e6, width=32) | st.just(float("nan")), min_size=1, max_size=50),
    st.sampled_from([1e-4, 1.0, 1e3]),
)
def test_packed_column_is_within_its_resolution(values, resolution):
    given_values = np.array(values)
    found = unpacked(packed(given_values, resolution=resolution))
    assert (np.isnan(found) == np.isnan(given_values)).all()
    error = np.abs(found - given_values)[~np.isnan(given_values)]
    # a float of 32 bits holds 24 of them; the whole numbers are computed with 53
    assert (error <= resolution * (1 + 1e-9) + 6e-8 * np.abs(given_values[~np.isnan(given_values)])).all()


def test_page_asks_for_nothing_and_runs_its_own_script_only():
    page = replay_page({"a": smooth_log()}, ALTEN, title="a")
    own = page.replace(plot_script(), "")  # whose comment names where it comes from
    for word in [
        "http:",
        "https:",
        "@import",
        "url(",
        "eval(",
        "Function(",
        "fetch(",
        "XMLHttp",
        "src=",
        "innerHTML",
    ]:
        assert word not in own, word
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', page)
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    (style,) = re.findall(r"<style>(.*?)</style>", page, flags=re.DOTALL)
    (script,) = re.findall(r"<script>(.*?)</script>", page, flags=re.DOTALL)
    for text in (style, script):
        assert base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() in policy


def test_name_of_a_log_is_text_and_nothing_else():
    name = "</script><script>alert(1)</script>\x1b[31m"
    page = replay_page({name: smooth_log()}, ALTEN, title=name)
    assert page.count("<script") == 2
    assert "\x1b" not in page
    assert data_of(page)["runs"][0]["name"].startswith("</script>")


@pytest.mark.parametrize("preset", Robot.presets())
def test_every_preset_can_be_drawn(preset):
    robot = Robot.load(preset)
    (run,) = data_of(replay_page({}, robot, title=preset))["runs"]
    shape = run["robot"]
    assert len(shape["wheels"]) == robot.wheel_count
    assert shape["body"]["top"] > shape["body"]["bottom"] > robot.ball.radius
    for wheel in shape["wheels"]:
        reach = np.linalg.norm(wheel["center"])
        assert reach == pytest.approx(robot.ball.radius + robot.wheels.radius)


def test_refusal_names_the_log():
    log = smooth_log(rows=10)
    bad = log.with_columns({"psi": np.full(10, np.nan)})
    with pytest.raises(InputError, match="bad: "):
        replay_page({"good": log, "bad": bad}, ALTEN, title="two")

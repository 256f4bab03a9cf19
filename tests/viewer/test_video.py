"""A replay as a video: each picture once and in order, and what ffmpeg says where it fails."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from ballbot.robot import Robot
from ballbot.viewer import replay_page
from ballbot.viewer.browser import installed_browser
from ballbot.viewer.video import RATE, SIZE, write_video
from tests.support.log_examples import smooth_log

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(installed_browser() is None, reason="no Chromium: apt-get install chromium"),
]


@pytest.fixture
def page():
    log = smooth_log(rows=400).between(0.0, 0.3)
    return replay_page({"a": log}, Robot.load("alten"), title="a", autoplay=False)


def install(folder, monkeypatch, program):
    """Let a program of Python be the ffmpeg that is found."""
    path = folder / "bin" / "ffmpeg"
    path.parent.mkdir()
    path.write_text(f"#!{sys.executable}\nimport sys\n{program}\n")
    path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{path.parent}{os.pathsep}{os.environ['PATH']}")


@pytest.mark.skipif(
    shutil.which("ffmpeg") is None or shutil.which("ffprobe") is None,
    reason="no ffmpeg: apt-get install ffmpeg",
)
@pytest.mark.parametrize("suffix", ["mp4", "webm", "gif"])
def test_video_has_the_rate_size_and_duration_of_the_log(page, tmp_path, suffix):
    file = tmp_path / f"a.{suffix}"
    write_video(page, file)
    probe = ("ffprobe", "-v", "error", "-count_frames", "-show_streams", "-show_format", "-of", "json", file)
    seen = json.loads(subprocess.run(probe, capture_output=True, check=True).stdout)
    (stream,) = seen["streams"]
    assert (stream["width"], stream["height"]) == SIZE
    assert stream["r_frame_rate"] == f"{RATE}/1"
    assert int(stream["nb_read_frames"]) == int(0.3 * RATE) + 1
    assert float(seen["format"]["duration"]) == pytest.approx(0.3, abs=1.0 / RATE)

"""A replay as a video: its page in Chromium without a window, picture by picture, into ffmpeg."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path

from ballbot.errors import InputError
from ballbot.files import check_file
from ballbot.progress import Progress, ProgressCallback, ignore_progress
from ballbot.viewer.browser import Tab, headless_browser

#: pictures a second, and their size [pixels]
RATE, SIZE = 25, (1280, 720)
#: colors of a .gif, of which it has 256: those of the first second, so that no more pictures are kept in memory
_PALETTE = f"split[seen][shown];[seen]trim=end_frame={RATE},palettegen[colors];[shown][colors]paletteuse"
#: lets the picture fill the window, with a clock
_FILL = """(() => {
  const stage = document.querySelector(".stage");
  Object.assign(stage.style, { position: "fixed", inset: 0, width: "100vw", height: "100vh", borderRadius: 0 });
  stage.style.zIndex = 9;
  const clock = document.createElement("div");
  clock.className = "video-clock";
  Object.assign(clock.style, { position: "absolute", right: "16px", top: "12px", fontVariantNumeric: "tabular-nums" });
  stage.append(clock);
})()"""
#: shows a time, and waits until it is drawn
_SHOW = """(() => {{
  const slider = document.querySelector(".time");
  slider.value = {time};
  slider.dispatchEvent(new Event("input"));
  document.querySelector(".video-clock").textContent = "{time:.1f} s";
  return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))));
}})()"""


def write_video(
    page: str,  # HTML of `ballbot.viewer.replay_page`, with logs and without autoplay
    path: Path,  # the file; its ending chooses the format, such as .mp4, .webm or .gif
    *,
    progress: ProgressCallback = ignore_progress,
) -> None:
    """Write a replay as a video, from its start to its end in real time.

    InputError if ffmpeg or Chromium is not installed, or ffmpeg cannot write such a file.
    """
    program = shutil.which("ffmpeg")
    if program is None:
        raise InputError(
            "A video needs ffmpeg, which is not installed (Debian and Ubuntu: apt-get install ffmpeg)."
        )
    target = check_file(path)
    with tempfile.TemporaryDirectory(prefix="ballbot-video-") as folder:
        file, made = Path(folder) / "replay.html", Path(folder) / f"video{path.suffix}"
        file.write_text(page, encoding="utf-8")
        with headless_browser(Path(folder) / "profile") as browser:
            tab = Tab(browser)
            tab.screen(*SIZE)
            tab.open(file)
            tab.wait("document.querySelector('.time') !== null")
            _encode(tab, program, made, progress)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(made, target)


def _encode(tab: Tab, program: str, made: Path, progress: ProgressCallback) -> None:
    tab.run(_FILL)
    duration = float(str(tab.run("Number(document.querySelector('.time').max)")))
    count = int(duration * RATE) + 1
    words = (
        "-y",
        "-loglevel",
        "error",
        "-f",
        "image2pipe",
        "-framerate",
        str(RATE),
        "-c:v",
        "mjpeg",
        "-i",
        "-",
    )
    is_gif = made.suffix.lower() == ".gif"
    pixels = ("-filter_complex", _PALETTE) if is_gif else ("-pix_fmt", "yuv420p")
    with (
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(
            (program, *words, *pixels, os.fspath(made)),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=errors,
        ) as encoder,
    ):
        assert encoder.stdin is not None
        with suppress(BrokenPipeError):  # it has ended, and its words say why
            for number in range(count):
                tab.run(_SHOW.format(time=number / RATE))
                encoder.stdin.write(tab.screenshot(kind="jpeg"))
                progress(Progress(stage="drawing", done=number + 1, total=count))
            encoder.stdin.close()
        if encoder.wait() != 0:
            errors.seek(0)
            said = errors.read().decode(errors="replace").strip().splitlines() or ["it gave no reason"]
            raise InputError(f"ffmpeg cannot write a {made.suffix or 'nameless'} video: {said[-1]}.")

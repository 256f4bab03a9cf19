"""Record the replay of `ballbot demo` around the square, as the animation with which the README opens.

.venv/bin/python -m campaigns.moving_picture

Chromium shows the page of the demo and is asked for one time after another; Pillow writes what it draws.
"""

import io
import tempfile
from pathlib import Path

from PIL import Image

from ballbot.report.demo import read_runs, robot_of_runs
from ballbot.viewer import replay_page
from tests.support.browser import Tab, headless_browser, new_tab

PATH = Path(__file__).parents[1] / "docs" / "images" / "demo.webp"
#: once around, from the square's first corner on [s]; shown so many times as fast, in so many frames a second
START, DURATION, SPEED, RATE = 8.0, 32.0, 4.0, 12.5
#: of the window [px]
SIZE = (760, 900)


def frame(tab: Tab, time: float) -> Image.Image:
    """Return the picture of the robots at a time [s]."""
    tab.page.fill(".time", str(time))
    tab.run("new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
    shown = tab.page.locator("canvas").first.screenshot()
    return Image.open(io.BytesIO(shown)).convert("RGB")


def main() -> None:
    """Record the replay and write the file."""
    page = replay_page(read_runs(), robot_of_runs(), title="demo")
    with tempfile.TemporaryDirectory() as folder, headless_browser() as browser:
        path = Path(folder) / "replay.html"
        path.write_text(page, encoding="utf-8")
        with new_tab(browser, size=SIZE) as tab:
            tab.page.goto(path.as_uri())
            tab.page.click("button.play")  # which it does by itself
            count = round(DURATION / SPEED * RATE)
            first, *others = [frame(tab, START + k * SPEED / RATE) for k in range(count)]
    first.save(
        PATH, save_all=True, append_images=others, duration=1000.0 / RATE, loop=0, quality=60, method=6
    )
    print(f"{PATH}: {count} frames, {PATH.stat().st_size} bytes")


if __name__ == "__main__":
    main()

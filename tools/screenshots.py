"""The pictures of the documentation: the replay page and the live page in a headless browser.

Needs a finished race and the extras ``play`` and ``dev``. ``--only hero`` is the looping picture of the
README, at a sixteenth of the pace:

    python tools/screenshots.py runs/race-... --browser /usr/bin/chromium
    python tools/screenshots.py runs/race-... --browser /usr/bin/chromium --only hero
"""

from __future__ import annotations

import argparse
import io
import subprocess
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, sync_playwright

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
FLAGS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
HERO_FRAMES, HERO_SECONDS, HERO_DURATION = 24, 0.3, 200  # pictures, of the run [s], each shown [ms]
PATIENCE = 120_000  # milliseconds


def save(picture: Path, name: str) -> None:
    """Store a screenshot with 256 colours, which is much smaller."""
    image = Image.open(picture).convert("RGB").quantize(256, Image.Quantize.FASTOCTREE)
    image.save(IMAGES / f"{name}.png", optimize=True)
    picture.unlink()


def replay(browser: Browser, page_file: Path, moment: float) -> None:
    """The replay page at a moment of the run [s]."""
    page = browser.new_page(viewport={"width": 1200, "height": 720})
    page.goto(page_file.resolve().as_uri())
    page.wait_for_function("window.replay !== undefined")
    page.evaluate("moment => { replay.setPlaying(false); replay.goTo(moment); }", moment)
    page.wait_for_timeout(500)
    page.screenshot(path=IMAGES / "raw.png")
    save(IMAGES / "raw.png", "replay")


def hero(browser: Browser, page_file: Path, moment: float) -> None:
    """The looping picture: 0.3 s of the run from a moment on [s], 1/16 of the pace, as an animated WebP."""
    page = browser.new_page(viewport={"width": 960, "height": 540})
    page.goto(page_file.resolve().as_uri())
    page.wait_for_function("window.replay !== undefined")
    page.evaluate("replay.setPlaying(false)")
    page.add_style_tag(content="#controls { display: none }")
    frames = []
    for number in range(HERO_FRAMES):
        page.evaluate("moment => replay.goTo(moment)", moment + number * HERO_SECONDS / HERO_FRAMES)
        page.wait_for_timeout(60)
        shot = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        frames.append(shot.resize((480, 270), Image.Resampling.LANCZOS))
    out = IMAGES / "sprint.webp"
    frames[0].save(
        out, save_all=True, append_images=frames[1:], duration=HERO_DURATION, loop=0, quality=45, method=4
    )
    print(f"{out}: {out.stat().st_size / 1e6:.2f} MB")


def play(browser: Browser, speed: float) -> None:
    """The live page while the robot runs."""
    command = [sys.executable, "-m", "sprintlab.cli.main", "play", "--port", "8391"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().split()[1]
        page = browser.new_page(viewport={"width": 1440, "height": 800})
        page.goto(address)
        page.wait_for_selector("#status", timeout=PATIENCE)
        slider = page.locator("input[type=text], input[inputmode]").first
        slider.fill(str(speed))
        slider.press("Enter")
        faster = f"Number(document.getElementById('status').dataset.speed) > {0.9 * speed}"
        page.wait_for_function(faster, timeout=PATIENCE)
        for button in page.locator(".mantine-Notification-closeButton").all():
            button.click()
        page.wait_for_timeout(3000)
        page.screenshot(path=IMAGES / "raw.png")
        save(IMAGES / "raw.png", "play")
        process.terminate()


def main() -> None:
    """Take the pictures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path, help="folder of a race")
    parser.add_argument("--browser", help="path of a Chromium; Playwright's own when left out")
    parser.add_argument(
        "--only", choices=("replay", "play", "hero"), help="one picture; replay and play else"
    )
    parser.add_argument(
        "--moment", type=float, default=8.08, help="of the recording, for replay and hero [s]"
    )
    given = parser.parse_args()
    IMAGES.mkdir(parents=True, exist_ok=True)
    page = given.run / "replay.html"
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=given.browser, args=FLAGS)
        if given.only in (None, "replay"):
            replay(browser, page, given.moment)
        if given.only in (None, "play"):
            play(browser, 8.0)
        if given.only == "hero":
            hero(browser, page, given.moment)
        browser.close()


if __name__ == "__main__":
    main()

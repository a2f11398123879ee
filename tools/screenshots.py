"""The pictures of the documentation: the replay page and the live page in a headless browser.

Needs a finished race and the extras ``play`` and ``dev``: ``python tools/screenshots.py runs/race-...``.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, sync_playwright

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
FLAGS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
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
    """Take both pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="folder of a race")
    parser.add_argument("--browser", help="path of a Chromium; Playwright's own when left out")
    given = parser.parse_args()
    IMAGES.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=given.browser, args=FLAGS)
        replay(browser, given.run / "replay.html", 8.08)
        play(browser, 8.0)
        browser.close()


if __name__ == "__main__":
    main()

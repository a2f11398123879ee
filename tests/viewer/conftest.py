"""A recorded run of two seconds, and a headless browser where there is one."""

import shutil

import numpy as np
import pytest

from sprintlab.control import load_policy, shipped_policy
from sprintlab.evaluation.results import TrialSettings
from sprintlab.evaluation.trial import TrialRequest, run_trial

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# WebGL without a GPU; no sandbox, because tests often run as root in a container.
FLAGS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]


@pytest.fixture(scope="session")
def policy():
    return load_policy(shipped_policy())


@pytest.fixture(scope="session")
def recorded(policy, robot):
    """Arrays of a run to 2 m/s, held for half a second."""
    request = TrialRequest(top_speed=2.0, hold=0.5, settings=TrialSettings(), keep_trajectory=True)
    trajectory = run_trial(policy, robot, request).trajectory
    assert trajectory is not None
    return trajectory.arrays()


@pytest.fixture(scope="session")
def trajectory_file(recorded, tmp_path_factory):
    path = tmp_path_factory.mktemp("race") / "trajectory.npz"
    np.savez_compressed(path, **recorded)
    return path


@pytest.fixture(scope="session")
def browser():
    """A Chromium driven by Playwright; its own download, or one of the system."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Playwright: pip install playwright")
    with playwright.sync_playwright() as driver:
        try:
            opened = driver.chromium.launch(args=FLAGS)
        except playwright.Error:
            system = next(filter(None, map(shutil.which, BROWSERS)), None)
            if system is None:
                pytest.skip("needs a browser: playwright install chromium, or Chromium from the system")
            opened = driver.chromium.launch(executable_path=system, args=FLAGS)
        yield opened
        opened.close()


@pytest.fixture
def tab(browser):
    """An empty page whose script errors fail the test."""
    page = browser.new_page(viewport={"width": 900, "height": 600})
    page.set_default_timeout(180_000)  # ms: software rendering on a shared core is slow
    errors = []
    page.on("pageerror", lambda error: errors.append(error))
    yield page
    page.close()
    assert errors == []

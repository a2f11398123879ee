"""The explorer's law in JavaScript is the law of `sprintlab.motors`, on random motors."""

import contextlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    PmsmParameters,
    critical_speed,
    load_library_motor,
    no_load_speed,
    torque_limits,
)

LAW = Path(__file__).resolve().parents[2] / "docs" / "explorer" / "law.js"
MODELS = ("refined", "simplified-dc", "square")
COUNT = 300

ANSWERS = """(cases) => cases.map(({ motor, speed, bus, models, currents }) => ({
  limits: models.map((model) => motorLaw.limits(motor, speed, bus, model)),
  critical: models.slice(0, 2).map((model) => motorLaw.criticalSpeed(motor, currents, bus, model)),
  noLoad: motorLaw.noLoadSpeed(motor, bus), constant: motorLaw.torqueConstant(motor),
}))"""


@pytest.fixture(scope="module")
def cases():
    """Motors from small servos to car drives, at speeds up to three times their no-load speed, L = 0 too."""
    random = np.random.default_rng(7)
    made = []
    index = 0
    while len(made) < COUNT:
        index += 1
        pairs, flux = int(random.integers(1, 30)), float(10.0 ** random.uniform(-3.5, -1.0))
        bus = float(random.uniform(12.0, 400.0))
        top = 0.95 * bus / np.sqrt(3.0) / (pairs * flux)
        motor = {
            "polePairs": pairs,
            "resistance": float(10.0 ** random.uniform(-3.0, 0.5)),
            "inductance": 0.0,
            "flux": flux,
            "peakCurrent": float(10.0 ** random.uniform(0.0, 2.5)),
        }
        if index % 20:
            motor["inductance"] = min(motor["resistance"] * float(10.0 ** random.uniform(-4.5, -1.5)), 0.01)
        speed = float(random.uniform(-3.0, 3.0) * top)
        case = {
            "motor": motor,
            "speed": speed,
            "bus": bus,
            "models": MODELS,
            "currents": motor["peakCurrent"],
        }
        with contextlib.suppress(InvalidValueError):  # no motor that anybody builds
            python_motor(case)
            made.append(case)
    return made


@pytest.fixture(scope="module", params=("browser", "node"))
def answers(request, cases):
    """The page's law on all cases, in a headless browser and where there is only Node.js."""
    if request.param == "browser":
        page = request.getfixturevalue("browser").new_page()
        page.add_script_tag(path=LAW)
        found = page.evaluate(ANSWERS, cases)
        page.close()
        return found
    if shutil.which("node") is None:
        pytest.skip("needs Node.js to run the page's law without a browser")
    program = f"const motorLaw = require({json.dumps(str(LAW))}); const answer = {ANSWERS};" + (
        'console.log(JSON.stringify(answer(JSON.parse(require("fs").readFileSync(0, "utf8")))));'
    )
    run = subprocess.run(
        ["node", "-e", program], input=json.dumps(cases), capture_output=True, text=True, check=True
    )
    return json.loads(run.stdout)


def python_motor(case):
    motor = case["motor"]
    return PmsmParameters(
        pole_pairs=motor["polePairs"],
        stator_resistance=motor["resistance"],
        q_axis_inductance=motor["inductance"],
        flux_linkage=motor["flux"],
        peak_torque=1.5 * motor["polePairs"] * motor["flux"] * motor["peakCurrent"],
        rotor_inertia=1e-4,
    )


@pytest.mark.parametrize("model", MODELS)
def test_limits_are_those_of_python(cases, answers, model):
    for case, answer in zip(cases, answers, strict=True):
        motor = python_motor(case)
        expected = torque_limits(motor, case["speed"], case["bus"], model=model)
        shown = answer["limits"][MODELS.index(model)]
        assert shown == pytest.approx(
            [float(limit) for limit in expected], rel=1e-6, abs=1e-6 * motor.peak_torque
        )


def test_critical_and_no_load_speeds_are_those_of_python(cases, answers):
    for case, answer in zip(cases, answers, strict=True):
        motor = python_motor(case)
        assert answer["noLoad"] == pytest.approx(float(no_load_speed(motor, case["bus"])))
        assert answer["constant"] == pytest.approx(float(motor.torque_constant))
        for model, shown in zip(MODELS, answer["critical"], strict=False):
            expected = float(critical_speed(motor, motor.peak_torque, case["bus"], model))
            assert shown == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_an_address_holds_the_motor(tab, tmp_path_factory):
    pytest.importorskip("material", reason="needs the extra docs")
    folder = tmp_path_factory.mktemp("site")
    build = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    subprocess.run(build, cwd=LAW.parents[2], check=True, capture_output=True)
    page = (folder / "explorer.html").as_uri()
    tab.goto(page)
    tab.locator("[name=library]").select_option("mit-mini-cheetah")
    tab.locator("[name=bus]").fill("30")
    address, rows = tab.evaluate("location.href"), tab.locator("#explorer tbody").inner_text()
    tab.goto("about:blank")
    tab.goto(address)
    assert "bus=30" in address and tab.locator("#explorer tbody").inner_text() == rows
    motor = load_library_motor("mit-mini-cheetah")
    no_load = float(no_load_speed(motor.motor, 30.0)) / float(motor.gear.ratio)
    assert f"{no_load:.3g} rad/s" in rows

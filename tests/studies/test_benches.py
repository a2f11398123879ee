"""The study of other people's benches: its laws, splits and thermal models on made-up data."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from studies.benches import heat
from studies.benches.laws import compared, gear_laws, saturation_laws
from studies.benches.predictions import PEAK_CURRENT, STATED_CONSTANT, Split, predicted

from sprintlab.workbench.identification import Bench

CONSTANT, SATURATION, COULOMB, VISCOUS = 0.032, 0.2, 0.03, 5e-5
PEAK = PEAK_CURRENT["d5065"]


def bench(seed, bend="quadratic", count=200):
    random = np.random.default_rng(seed)
    current = random.uniform(-PEAK, PEAK, count)
    speed = random.uniform(20.0, 300.0, count) * random.choice([-1.0, 1.0], count)
    share = np.abs(current) / PEAK
    if bend == "knee":
        bent = np.minimum(share, 0.7) + 0.1 * np.log2(1 + np.maximum(share - 0.7, 0))
        torque = CONSTANT * np.sign(current) * PEAK * bent
    else:
        torque = CONSTANT * current * (1.0 - SATURATION * share)
    torque = torque - COULOMB * np.sign(speed) - VISCOUS * speed + random.normal(0.0, 0.003, count)
    rows = {
        "d_current": np.zeros(count),
        "limited": np.zeros(count, dtype=bool),
        "lines": np.arange(count) + 2,
    }
    return Bench(current=current, torque=torque, speed=speed, **rows)


def split(bend="quadratic"):
    return Split(motor="d5065", name="made up", known=bench(1, bend), held_out=bench(2, bend))


def test_a_known_motor_is_predicted_to_its_noise():
    found = predicted(split())
    assert found["error"]["rms"] == pytest.approx(0.003, rel=0.15)
    assert found["parameters"]["torque_constant"]["value"] == pytest.approx(CONSTANT, rel=0.01)
    assert found["parameters"]["saturation"]["value"] == pytest.approx(SATURATION, abs=0.02)
    assert found["error_of_constant"]["rms"] > 0.1 > abs(STATED_CONSTANT["d5065"] - CONSTANT)


@pytest.mark.parametrize(
    ("bend", "best"), [("quadratic", "quadratic (the paper)"), ("knee", "logarithmic (moteus)")]
)
def test_the_law_that_made_the_data_wins(bend, best):
    laws = compared(split(bend), saturation_laws)["laws"]
    assert laws[best]["criterion_over_best"] == 0.0
    assert laws["linear"]["criterion_over_best"] > 100.0
    assert min(laws, key=lambda name: laws[name]["error"]["rms"]) == best


@given(st.floats(0.0, 0.4), st.floats(-0.15, 0.15))
def test_the_law_of_two_frictions_is_an_efficiency_and_another_torque_constant(average, difference):
    laws = {law.name: law for law in gear_laws(1.0, 10.0)}
    current = np.linspace(-10.0, 10.0, 41)
    drives, brakes = 1.0 - average - difference, 1.0 + average - difference
    efficiency, constant = np.sqrt(drives / brakes), np.sqrt(drives * brakes)
    for direction in (-np.ones(41), np.ones(41)):
        theirs = np.array([1.0, 0.1, average, difference]), current, direction
        ours = np.array([constant, 0.1, efficiency]), current, direction
        expected = laws["mu_avg and mu_dif"].torque(*theirs)
        np.testing.assert_allclose(laws["efficiency (ours)"].torque(*ours), expected, atol=1e-12)


def heating(seed, parameters, levels):
    current = np.repeat(levels, 60).astype(float)
    blank = heat.Run(name="run", current=current, temperature=np.full(len(current), 25.0), ambient=22.0)
    noise = np.random.default_rng(seed).normal(0.0, 0.05, len(current))
    return replace(blank, temperature=heat.simulated(parameters, blank) + noise)


@pytest.mark.parametrize(
    "parameters", [(2e-3, 120.0), (2e-3, 30.0, 6.0, 700.0)], ids=["one node", "two nodes"]
)
def test_temperatures_are_predicted_by_the_nodes_that_made_them(parameters):
    nodes = len(parameters) // 2
    known = heating(1, parameters, (12, 0, 10, 0, 8, 0))
    other = heating(2, parameters, (6, 12, 0, 9))
    found = heat.fitted(known, nodes)
    np.testing.assert_allclose(found[:2], parameters[:2], rtol=0.1)
    error = heat.simulated(found.tolist(), other) - other.temperature
    assert np.sqrt(np.mean(error**2)) < 0.2
    if nodes == 2:
        worse = heat.simulated(heat.fitted(known, 1).tolist(), other) - other.temperature
        assert np.sqrt(np.mean(worse**2)) > 1.0

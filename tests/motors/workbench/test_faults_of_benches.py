"""Faults that measured benches have: noisy steps of current, wrong zeros, gears, warm magnets, standstill."""

import numpy as np
import pytest
from tests.motors.workbench.benches import bench, said

from sprintlab.workbench.identification import identify

PAIRS, FLUX, SATURATION, PEAK = 21, 6.08e-3, 0.15, 60.0
CONSTANT = 1.5 * PAIRS * FLUX
COULOMB, VISCOUS = 0.05, 3e-4
RESISTANCE, INDUCTANCE = 0.158, 84e-6


def points(seed, levels=9, rows=20, largest=40.0):
    """Stepped currents, each at random speeds of either direction; and the random numbers that go on."""
    random = np.random.default_rng(seed)
    current = np.tile(np.linspace(-largest, largest, levels), rows)
    speed = random.uniform(10.0, 200.0, len(current)) * random.choice([-1.0, 1.0], len(current))
    return current, speed, random


def shaft(current, speed, efficiency=1.0):
    """Torque on the shaft [N m] by the law of the model."""
    ideal = CONSTANT * current * (1.0 - SATURATION * np.abs(current) / PEAK)
    return ideal * efficiency ** np.sign(current * speed) - COULOMB * np.sign(speed) - VISCOUS * speed


def fitted(data, **options):
    return identify(data, pole_pairs=PAIRS, peak_current=PEAK, **options)


def test_the_zero_of_the_torque_sensor_is_noticed_and_fitted():
    current, speed, random = points(1)
    torque = shaft(current, speed) + 0.3 + random.normal(0.0, 0.02, len(current))
    data = bench(current, torque, speed)
    assert said(fitted(data), "--also torque_offset")
    found = fitted(data, also=("torque_offset",))
    offset = found.estimates["torque_offset"]
    assert offset.determined and abs(offset.value - 0.3) < 1.6 * offset.half_width
    assert not said(found, "--also")


def test_the_zero_of_the_current_sensor_is_told_from_the_torques_by_the_voltage():
    current, speed, random = points(2)
    electrical = PAIRS * speed
    count = len(current)
    data = bench(
        current + 0.8,
        shaft(current, speed) - 0.1 + random.normal(0.0, 0.02, count),
        speed,
        q_voltage=RESISTANCE * current + electrical * FLUX + random.normal(0.0, 0.02, count),
        d_voltage=-electrical * INDUCTANCE * current + random.normal(0.0, 0.02, count),
    )
    found = fitted(data, also=("torque_offset", "current_offset"))
    for name, value in {"current_offset": 0.8, "torque_offset": -0.1, "flux_linkage": FLUX}.items():
        estimate = found.estimates[name]
        assert estimate.determined and abs(estimate.value - value) < 1.6 * estimate.half_width, name


def test_a_gear_that_loses_with_the_load_is_noticed_and_fitted():
    """An ampere gives 2.9 N m driving and takes 4.1 braking, as on a joint of a legged robot."""
    current, speed, random = points(4)
    ideal, efficiency = np.sqrt(2.9 * 4.1), np.sqrt(2.9 / 4.1)
    torque = ideal * current * efficiency ** np.sign(current * speed) + random.normal(0.0, 0.5, len(current))
    data = bench(current, torque, speed)
    plain = fitted(data)
    assert said(plain, "--also gear_efficiency")
    found = fitted(data, also=("gear_efficiency",))
    estimate = found.estimates["gear_efficiency"]
    assert estimate.determined and abs(estimate.value - efficiency) < 1.6 * estimate.half_width
    assert found.torque_constant == pytest.approx(ideal, rel=0.02)
    assert not said(found, "driving")


def test_a_sound_bench_needs_none_of_it():
    for seed in range(12):
        current, speed, random = points(seed)
        torque = shaft(current, speed) + random.normal(0.0, 0.03, len(current))
        assert not said(fitted(bench(current, torque, speed)), "--also")


def test_a_flux_that_drifts_as_no_magnet_does_is_told():
    current, speed, random = points(5)
    temperature = random.uniform(30.0, 90.0, len(current))
    for drift, unsound in ((-0.006, True), (-0.0011, False)):
        noise = random.normal(0.0, 0.02, len(current))
        torque = shaft(current, speed) + drift * (temperature - 20.0) * CONSTANT * current + noise
        found = fitted(bench(current, torque, speed, temperature=temperature))
        assert said(found, "no magnet's") == unsound

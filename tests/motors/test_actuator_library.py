"""The library: every number has a source, and the sets hang together."""

import math
from importlib import resources

import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    joint_torque,
    library_motors,
    load_library_motor,
    no_load_speed,
    saturate,
)
from sprintlab.motors.actuator_library import actuator_from_toml

NAMES = library_motors()


@pytest.mark.parametrize("name", NAMES)
def test_every_number_has_a_source_and_an_estimate_says_so(name):
    actuator = load_library_motor(name)
    assert len(actuator.values) == 10
    for value in actuator.values.values():
        assert len(value.source) > 10 or not value.estimated
        assert not value.source.startswith("not published") or value.estimated
    electrical = ("stator_resistance", "q_axis_inductance", "flux_linkage", "peak_torque")
    assert not {f"motor.{field}" for field in electrical} & set(actuator.estimated)


@pytest.mark.parametrize(
    ("name", "peak", "no_load"),
    [  # published: peak torque [N m] and no-load speed [rad/s] behind the gear
        ("mit-humanoid-u12", 72.0, 40.0),  # speed limit of the robot
        ("t-motor-ak80-6", 12.0, 38.2),  # at 24 V
        ("xiaomi-cybergear", 12.0, 296 * math.pi / 30),
        ("cubemars-ake80-8", 30.0, 195 * math.pi / 30),
    ],
)
def test_agrees_with_published_numbers_that_it_was_not_made_from(name, peak, no_load):
    actuator = load_library_motor(name)
    torque = joint_torque(actuator.gear, saturate(actuator.motor, actuator.motor.peak_torque))
    assert torque == pytest.approx(peak, rel=0.15)
    speed = no_load_speed(actuator.motor, actuator.bus_voltage) / actuator.gear.ratio
    assert speed == pytest.approx(no_load, rel=0.15)  # data sheets use the whole bus, we 95 % of it


def test_a_broken_file_is_refused():
    whole = (resources.files("sprintlab.motors") / "library" / "t-motor-ak80-6.toml").read_text("utf-8")
    for old, new, message in (
        ("source = ", "origin = ", "bus_voltage"),
        ("[motor.flux_linkage]", "[motor.flux]", "motor = 'flux'"),
        ("value = 0.085", "value = 85.0", "stator_resistance"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            actuator_from_toml("x", whole.replace(old, new, 1))

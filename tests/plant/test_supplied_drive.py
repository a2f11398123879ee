"""The plant's drives on a battery and with warm windings, against the general laws."""

import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    Battery,
    HousedHeat,
    I2tLimit,
    PmsmParameters,
    WindingHeat,
    battery_current,
    copper_loss,
    discharged,
    drive_torque,
    flux_factor,
    heated_motor,
    i2t_current,
    i2t_decay,
    i2t_drive,
    i2t_level,
    loaded_voltage,
    open_circuit_voltage,
    saturate,
    squared_current,
    unchecked,
    warmed,
    warmed_with_housing,
)
from sprintlab.plant import Plant, PlantOptions, SuppliedDrive, TrialSettings
from sprintlab.robots import load_robot

ROBOT = load_robot("bp2")
STEP = 0.001


def motion(count=200, seed=2):
    """Wanted torques and joint velocities that wander up to and over the envelope, ``(count, 12)`` each."""
    random = np.random.default_rng(seed)
    walks = np.cumsum(random.normal(size=(2, count, 12)), axis=1)
    return 12.0 * walks[0], 4.0 * walks[1]


@pytest.mark.parametrize("model", ["refined", "flux-weakening"])
def test_every_step_agrees_with_the_laws_it_is_made_of(model):
    battery, heat = Battery(), WindingHeat(heat_capacity=30.0)
    drive = SuppliedDrive(
        ROBOT,
        PlantOptions(
            motor_model=model, battery=battery, state_of_charge=0.7, heat=heat, winding_temperature=60.0
        ),
    )
    limited = 0
    for desired, velocity in zip(*motion(), strict=True):
        before = drive.state
        output = drive(desired, velocity)
        after = drive.state
        motors = heated_motor(ROBOT.motors, heat, before.winding_temperature)
        asked = desired * flux_factor(heat, before.winding_temperature)
        expected = drive_torque(motors, ROBOT.gear, asked, velocity, after.bus_voltage, model)
        for got, wanted in zip(output, expected, strict=True):
            np.testing.assert_allclose(np.broadcast_to(got, 12), wanted, atol=1e-9)
        loss = copper_loss(motors, output.motor_torque, output.direct_current)
        shaft = saturate(motors, output.motor_torque)
        power = (shaft * velocity * ROBOT.gear.ratio + loss).sum()
        left = float(loaded_voltage(battery, before.state_of_charge, power))
        assert after.bus_voltage == pytest.approx(left, abs=1e-3)
        np.testing.assert_allclose(
            after.winding_temperature, warmed(heat, before.winding_temperature, loss, STEP)
        )
        current = battery_current(battery, after.bus_voltage, power)
        charge = discharged(battery, before.state_of_charge, current, STEP)
        assert after.state_of_charge == pytest.approx(charge, abs=1e-9)
        limited += int((np.abs(output.motor_torque - asked / ROBOT.gear.ratio) > 1e-9).any())
    assert 20 < limited < 200
    assert np.ptp(after.winding_temperature) > 1.0


@pytest.mark.parametrize("model", ["refined", "square", "flux-weakening"])
def test_i2t_is_that_of_the_motor_package_step_by_step(model):
    limit = I2tLimit(continuous_current=np.linspace(8.0, 30.0, 12), peak_duration=0.05)
    drive, decay = (
        SuppliedDrive(ROBOT, PlantOptions(motor_model=model, i2t=limit)),
        i2t_decay(limit, ROBOT.motors, STEP),
    )
    level, cut = np.zeros(12), 0
    for desired, velocity in zip(*motion(), strict=True):
        output = drive(desired, velocity)
        expected, level = i2t_drive(
            ROBOT.motors, ROBOT.gear, limit.continuous_current, level, decay, desired, velocity, 60.0, model
        )
        for got, wanted in zip(output, expected, strict=True):
            np.testing.assert_allclose(np.broadcast_to(got, 12), wanted, atol=1e-7)
        np.testing.assert_allclose(drive.state.i2t_level, level, atol=1e-9)
        cut += int((i2t_current(limit.continuous_current, level, decay) < 40.0).any())
    assert cut > 50
    assert drive.state.winding_temperature is None


def test_warm_drives_on_a_battery_count_the_currents_that_flow():
    limit = I2tLimit(continuous_current=15.0, time_constant=0.2)
    decay = i2t_decay(limit, ROBOT.motors, STEP)
    battery, heat = Battery(), WindingHeat(heat_capacity=30.0)
    drive = SuppliedDrive(
        ROBOT, PlantOptions(battery=battery, heat=heat, winding_temperature=60.0, i2t=limit)
    )
    for desired, velocity in zip(*motion(), strict=True):
        before = drive.state
        output = drive(desired, velocity)
        motors = heated_motor(ROBOT.motors, heat, before.winding_temperature)
        allowed = motors.torque_constant * i2t_current(15.0, before.i2t_level, decay)
        limited = unchecked(
            PmsmParameters, {**vars(motors), "peak_torque": np.minimum(motors.peak_torque, allowed)}
        )
        asked = desired * flux_factor(heat, before.winding_temperature)
        expected = drive_torque(limited, ROBOT.gear, asked, velocity, drive.state.bus_voltage)
        np.testing.assert_allclose(output.motor_torque, expected.motor_torque, atol=1e-9)
        flowing = squared_current(motors, output)
        np.testing.assert_allclose(
            drive.state.i2t_level, i2t_level(15.0, before.i2t_level, flowing, decay), atol=1e-12
        )
    assert drive.state.i2t_level.max() > 0.99


def test_winding_and_housing_warm_by_the_law_of_two_nodes():
    heat = HousedHeat(heat_capacity=2.0, housing_heat_capacity=4.0, housing_thermal_resistance=0.3)
    drive = SuppliedDrive(ROBOT, PlantOptions(heat=heat, winding_temperature=40.0))
    housing = drive.state.winding_temperature
    for desired, velocity in zip(*motion(), strict=True):
        before = drive.state
        output = drive(desired, velocity)
        motors = heated_motor(ROBOT.motors, heat, before.winding_temperature)
        loss = copper_loss(motors, output.motor_torque)
        winding, housing = warmed_with_housing(heat, before.winding_temperature, housing, loss, STEP)
        np.testing.assert_allclose(drive.state.winding_temperature, winding)
    assert housing.max() > 40.5


def test_the_plant_uses_them_only_where_asked(standing_targets):
    plain = Plant(ROBOT, PlantOptions(), TrialSettings())
    assert plain.supply is None
    weakening = Plant(ROBOT, PlantOptions(motor_model="flux-weakening"), TrialSettings())
    assert weakening.supply is not None
    assert weakening.supply.bus_voltage == ROBOT.bus_voltage
    options = PlantOptions(
        battery=Battery(), heat=WindingHeat(), state_of_charge=0.5, winding_temperature=80.0
    )
    plant = Plant(ROBOT, options, TrialSettings())
    assert plant.supply is not None
    assert plant.supply.state_of_charge == 0.5
    plant.advance(standing_targets, 200)
    assert plant.supply.bus_voltage < float(open_circuit_voltage(Battery(), 0.5))
    assert plant.supply.state_of_charge < 0.5
    winding = plant.supply.winding_temperature
    assert 79.5 < winding.min() < winding.max() - 0.01  # abduction bears next to nothing and cools down
    loss = np.asarray(plant.supply.copper_loss)
    assert loss[::3].max() < loss[2::3].max()


@pytest.fixture
def standing_targets():
    return np.asarray(ROBOT.default_pose, dtype=float)


def test_heat_and_limits_of_another_number_of_motors_are_refused():
    with pytest.raises(InvalidValueError, match=r"heat\.heat_capacity = '5 numbers'"):
        SuppliedDrive(ROBOT, PlantOptions(heat=WindingHeat(heat_capacity=np.full(5, 100.0))))
    limit = I2tLimit(continuous_current=np.full(5, 10.0), time_constant=1.0)
    with pytest.raises(InvalidValueError, match=r"i2t\.continuous_current = '5 numbers'"):
        SuppliedDrive(ROBOT, PlantOptions(i2t=limit))
    with pytest.raises(InvalidValueError, match="must lie below the peak current"):
        SuppliedDrive(ROBOT, PlantOptions(i2t=I2tLimit(continuous_current=500.0, time_constant=1.0)))


@pytest.mark.parametrize(("name", "full"), [("bp2", 58.8), ("go1", 25.2), ("go2", 33.6)])
def test_a_robot_stands_on_the_cells_of_its_own_table(name: str, full: float) -> None:
    robot = load_robot(name)
    plant = Plant(robot, PlantOptions(battery="robot"), TrialSettings())
    plant.advance(robot.default_pose, 1)
    assert plant.supply is not None
    assert plant.supply.bus_voltage == pytest.approx(full, rel=0.01)

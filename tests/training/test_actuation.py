"""The Warp kernel and the NumPy law are the same law."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco_warp")

import torch
import warp as wp

from sprintlab.control import pd_torque
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    MOTOR_MODELS,
    Battery,
    MotorModel,
    WindingHeat,
    battery_current,
    copper_loss,
    discharged,
    drive_torque,
    electrical_power,
    flux_factor,
    heated_motor,
    loaded_voltage,
    phase_voltage_limit,
    shared_bus_voltage,
    warmed,
)
from sprintlab.robots import load_robot, soft_stop_torque
from sprintlab.training.environment.actuation import (
    FRICTION_SPEED,
    MODEL_CODES,
    JointDrive,
    JointHeat,
    joint_torque_kernel,
)
from sprintlab.training.environment.simulation import BatchSimulation, _joint_drives, training_model
from sprintlab.training.environment.supply import joint_heats
from sprintlab.training.runs.run import TrainOptions
from sprintlab.training.settings import SimulationSettings, TrainingSettings

ENVIRONMENTS = 256
DELAY = 3
ROBOT = load_robot("bp2")
MODEL = training_model(ROBOT, SimulationSettings(environments=ENVIRONMENTS))


@pytest.fixture(scope="module")
def inputs() -> dict[str, np.ndarray]:
    """Random states far beyond the no-load speed and both end stops, in float32 as the kernel sees them."""
    random = np.random.default_rng(5)
    shape = (ENVIRONMENTS, 12)
    limits = ROBOT.position_limits
    drawn = {
        "target": random.uniform(limits[:, 0] - 1, limits[:, 1] + 1, shape),
        "previous_target": random.uniform(limits[:, 0] - 1, limits[:, 1] + 1, shape),
        "stiffness": ROBOT.stiffness * random.uniform(0.5, 2, shape),
        "damping": ROBOT.damping * random.uniform(0.5, 2, shape),
        "strength": random.uniform(0.8, 1.2, shape),
        "resistance_factor": random.uniform(0.8, 1.5, ENVIRONMENTS),
        "friction_factor": random.uniform(0.5, 1.5, ENVIRONMENTS),
        "bus": ROBOT.bus_voltage * random.uniform(0.3, 1.0, ENVIRONMENTS),
        "qpos": np.zeros((ENVIRONMENTS, MODEL.nq)),
        "qvel": np.zeros((ENVIRONMENTS, MODEL.nv)),
    }
    position, velocity = joint_addresses()
    drawn["qpos"][:, position] = random.uniform(limits[:, 0] - 0.1, limits[:, 1] + 0.1, shape)
    drawn["qvel"][:, velocity] = random.uniform(-80, 80, shape)
    return {name: values.astype(np.float32) for name, values in drawn.items()}


def joint_addresses() -> tuple[list[int], list[int]]:
    joints = [MODEL.joint(name) for name in ROBOT.joint_names]
    return [int(joint.qposadr[0]) for joint in joints], [int(joint.dofadr[0]) for joint in joints]


def kernel_torque(
    inputs: dict[str, np.ndarray],
    model: str,
    substep: int = DELAY,
    heat: WindingHeat | None = None,
    temperature: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The kernel's ``control``, ``drive_torque`` and ``on_limit``, each ``(n, 12)``.

    ``temperature`` ``(n, 12)`` is changed in place where ``heat`` is given.
    """
    settings = SimulationSettings(environments=ENVIRONMENTS, heat=heat)
    winding = wp.zeros((1, 12), dtype=float, device="cpu")
    if temperature is not None:
        winding = wp.array(temperature, dtype=float, device="cpu", copy=False)
    voltage = phase_voltage_limit(inputs["bus"]).astype(np.float32)
    names = ("stiffness", "damping", "strength", "resistance_factor", "friction_factor")
    targets, delay = (inputs["target"], inputs["previous_target"]), np.full(ENVIRONMENTS, DELAY, np.int32)
    outputs = [wp.zeros((ENVIRONMENTS, 12), dtype=float, device="cpu") for _ in range(4)]
    values = [*(inputs[name] for name in names), voltage, inputs["qpos"], inputs["qvel"]]
    wp.launch(
        joint_torque_kernel,
        dim=(ENVIRONMENTS, 12),
        inputs=[
            wp.array(_joint_drives(ROBOT, MODEL), dtype=JointDrive, device="cpu"),
            wp.array(joint_heats(settings, 12), dtype=JointHeat, device="cpu"),
            *(wp.array(value, dtype=float, device="cpu") for value in targets),
            wp.array(delay, dtype=int, device="cpu"),
            *(wp.array(value, dtype=float, device="cpu") for value in values),
            MODEL_CODES[model],
            int(heat is not None),
            1.0,
            substep,
        ],
        outputs=[winding, *outputs],
        device="cpu",
    )
    control, drive, on_limit, _ = (output.numpy() for output in outputs)
    return control, drive, on_limit


@pytest.mark.parametrize("model", MOTOR_MODELS)
def test_the_kernel_is_the_library_s_law(inputs: dict[str, np.ndarray], model: str) -> None:
    x = {name: values.astype(np.float64) for name, values in inputs.items()}
    positions, velocities = joint_addresses()
    position, velocity = x["qpos"][:, positions], x["qvel"][:, velocities]
    resistance = ROBOT.motors.stator_resistance * x["resistance_factor"][:, None]
    wanted = pd_torque(x["stiffness"], x["damping"], x["target"], position, velocity)
    motors = replace(ROBOT.motors, stator_resistance=resistance)
    output = drive_torque(motors, ROBOT.gear, wanted, velocity, x["bus"][:, None], model)
    delivered = output.torque * x["strength"]
    friction = ROBOT.dry_friction * x["friction_factor"][:, None] * np.tanh(velocity / FRICTION_SPEED)
    stop = soft_stop_torque(position, velocity, ROBOT.position_limits, ROBOT.soft_stop)
    control, drive, on_limit = kernel_torque(inputs, model)
    assert np.abs(stop).max() > 1.0
    assert 0.05 < on_limit.mean() < 1.0
    np.testing.assert_allclose(drive, delivered, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(control, delivered - friction + stop, rtol=1e-4, atol=1e-3)


def test_the_models_differ_on_these_inputs(inputs: dict[str, np.ndarray]) -> None:
    refined, simplified, square, weakened = (kernel_torque(inputs, model)[1] for model in MOTOR_MODELS)
    assert np.abs(refined - weakened).max() > 1.0
    assert np.abs(refined - simplified).max() > 1.0
    assert np.abs(simplified - square).max() > 1.0


def test_the_previous_target_holds_until_the_delay_is_over(inputs: dict[str, np.ndarray]) -> None:
    swapped = {**inputs, "target": inputs["previous_target"], "previous_target": inputs["target"]}
    early, late = (kernel_torque(inputs, "refined", substep)[1] for substep in (DELAY - 1, DELAY))
    assert np.abs(early - late).max() > 1.0
    np.testing.assert_array_equal(early, kernel_torque(swapped, "refined", DELAY)[1])


@pytest.mark.parametrize("model", ("refined", "flux-weakening"))
def test_the_kernel_warms_the_windings_like_the_library(inputs: dict[str, np.ndarray], model: str) -> None:
    heat = WindingHeat(heat_capacity=20.0, thermal_resistance=np.linspace(0.5, 2.0, 12), magnet_share=0.8)
    before = np.random.default_rng(6).uniform(0.0, 180.0, (ENVIRONMENTS, 12)).astype(np.float32)
    after = before.copy()
    _, drive, _ = kernel_torque(inputs, model, heat=heat, temperature=after)
    x = {name: values.astype(np.float64) for name, values in inputs.items()}
    positions, velocities = joint_addresses()
    velocity = x["qvel"][:, velocities]
    scattered = replace(
        ROBOT.motors, stator_resistance=ROBOT.motors.stator_resistance * x["resistance_factor"][:, None]
    )
    motors = heated_motor(scattered, heat, before.astype(np.float64))
    wanted = pd_torque(x["stiffness"], x["damping"], x["target"], x["qpos"][:, positions], velocity)
    wanted = wanted * flux_factor(heat, before.astype(np.float64))
    output = drive_torque(motors, ROBOT.gear, wanted, velocity, x["bus"][:, None], model)
    loss = copper_loss(motors, output.motor_torque, output.direct_current)
    np.testing.assert_allclose(drive, output.torque * x["strength"], rtol=1e-4, atol=2e-3)
    expected = warmed(heat, before.astype(np.float64), loss, SimulationSettings().timestep)
    assert np.abs(expected - before).max() > 0.1
    np.testing.assert_allclose(after, expected, rtol=1e-5, atol=1e-3)


@pytest.fixture(scope="module")
def supplied() -> BatchSimulation:
    settings = SimulationSettings(
        environments=ENVIRONMENTS, battery=Battery(internal_resistance=0.05), heat=WindingHeat()
    )
    return BatchSimulation(ROBOT, settings, "refined", "cpu")


def loaded(
    simulation: BatchSimulation, inputs: dict[str, np.ndarray], model: MotorModel = "refined"
) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """Put robots into hard work; their charges, and their power at a bus voltage by the library."""
    battery, heat = simulation.settings.battery, simulation.settings.heat
    assert battery is not None and heat is not None
    for name in ("target", "previous_target", "stiffness", "damping", "resistance_factor", "qpos", "qvel"):
        getattr(simulation, name).copy_(torch.as_tensor(inputs[name]))
    simulation.qvel.mul_(0.5)
    simulation.target.copy_(
        0.3 * (simulation.target - simulation.qpos[:, joint_addresses()[0]]) + simulation.target
    )
    charge, temperature = (
        getattr(simulation.supply, name).double().numpy().copy()
        for name in ("state_of_charge", "winding_temperature")
    )
    assert np.ptp(charge) > 0.5 and np.ptp(temperature) > 50.0
    x = {name: getattr(simulation, name).double().numpy() for name in ("target", "stiffness", "damping")}
    positions, velocities = joint_addresses()
    position, velocity = (
        simulation.qpos.double().numpy()[:, positions],
        simulation.qvel.double().numpy()[:, velocities],
    )
    factor = simulation.resistance_factor.double().numpy()[:, None]
    cold = replace(ROBOT.motors, stator_resistance=ROBOT.motors.stator_resistance * factor)
    motors = heated_motor(cold, heat, temperature)
    wanted = pd_torque(x["stiffness"], x["damping"], x["target"], position, velocity)
    wanted = wanted * flux_factor(heat, temperature)

    def power_at(bus: np.ndarray) -> np.ndarray:
        output = drive_torque(motors, ROBOT.gear, wanted, velocity, bus[:, None], model)
        speed = velocity * ROBOT.gear.ratio
        return electrical_power(motors, output.motor_torque, speed, output.direct_current).sum(axis=1)

    return charge, power_at


def test_the_battery_kernel_finds_the_library_s_voltage(
    supplied: BatchSimulation, inputs: dict[str, np.ndarray]
) -> None:
    battery = supplied.settings.battery
    assert battery is not None
    charge, power_at = loaded(supplied, inputs)
    expected = shared_bus_voltage(battery, charge, power_at)
    supplied.supply.launch(0)
    found = supplied.voltage.double().numpy() / phase_voltage_limit(1.0)
    assert np.ptp(found) > 10.0
    np.testing.assert_allclose(found, expected, atol=2e-3)
    current = battery_current(battery, expected, power_at(expected))
    assert (current < 0).any() and (current > 0).any()
    left = discharged(battery, charge, current, supplied.settings.timestep)
    np.testing.assert_allclose(supplied.supply.state_of_charge.numpy(), left, atol=1e-6)


@pytest.mark.parametrize("model", ["refined", "flux-weakening"])
@pytest.mark.parametrize("resistance", [0.3, 1.0])
def test_the_battery_kernel_ends_every_search(
    inputs: dict[str, np.ndarray], model: MotorModel, resistance: float
) -> None:
    """A weak pack near its collapse; single precision finds the change of sign, or its neighbourhood.

    Looked for at several distances: where a pack collapses, the next change of sign may be millivolts away.
    """
    torch.manual_seed(5)
    battery = Battery(internal_resistance=resistance, regeneration_limit=100.0)
    settings = SimulationSettings(environments=ENVIRONMENTS, battery=battery, heat=WindingHeat())
    simulation = BatchSimulation(ROBOT, settings, model, "cpu")
    charge, power_at = loaded(simulation, inputs, model)
    simulation.supply.launch(0)
    found = simulation.voltage.double().numpy() / phase_voltage_limit(1.0)

    def excess(bus: np.ndarray) -> np.ndarray:
        return bus - loaded_voltage(battery, charge, power_at(bus))

    distances = (1e-3, 2e-3, 5e-3, 1e-2)
    changes = [(excess(found - away) <= 0) & (excess(found + away) >= 0) for away in distances]
    assert np.any(changes, axis=0).all()


def test_standing_draws_charge_and_a_restart_gives_it_back_or_takes_the_donor_s(
    supplied: BatchSimulation,
) -> None:
    reset_mask, copied = (torch.zeros(ENVIRONMENTS, dtype=torch.bool) for _ in range(2))
    reset_mask[::2], copied[1::4] = True, True
    donors = torch.arange(ENVIRONMENTS).flip(0)
    state = (supplied.supply.state_of_charge, supplied.supply.winding_temperature)
    supplied.supply.restart(torch.ones_like(reset_mask), torch.zeros_like(reset_mask), donors)
    first = [values.clone() for values in state]
    supplied.step()
    run = [values.clone() for values in state]
    assert all((now != then).float().mean() > 0.5 for now, then in zip(run, first, strict=True))
    supplied.supply.restart(reset_mask, copied, donors)
    kept = ~(reset_mask | copied)
    for now, before, start in zip(state, run, first, strict=True):
        assert (now[reset_mask] == start[reset_mask]).all()
        assert (now[copied] == before[donors[copied]]).all()
        assert (now[kept] == before[kept]).all()


def test_without_battery_and_heat_nothing_of_them_changes() -> None:
    simulation = BatchSimulation(ROBOT, SimulationSettings(environments=2), "refined", "cpu")
    voltage = simulation.voltage.clone()
    simulation.step()
    assert simulation.supply.state_of_charge.tolist() == [1.0]
    assert (simulation.supply.winding_temperature == 0.0).all()
    assert (simulation.voltage == voltage).all()


def test_a_method_trains_on_flux_weakening_battery_and_heat_where_asked() -> None:
    simulation = SimulationSettings(battery=Battery(series_cells=13), heat=WindingHeat())
    settings = TrainingSettings(actuator_model="flux-weakening", simulation=simulation)
    kept = TrainOptions(settings=settings, keep_motor_model=True).full_settings()
    assert kept.actuator_model == "flux-weakening"
    assert kept.simulation.battery == Battery(series_cells=13)
    assert TrainOptions(settings=settings).full_settings().actuator_model == "refined"
    assert json.loads(json.dumps(kept.as_dict()))["simulation"]["battery"]["series_cells"] == 13
    assert kept.digest() != TrainOptions().full_settings().digest()


@pytest.mark.parametrize(
    ("field", "value"), [("state_of_charge", (0.5, 1.5)), ("winding_temperature", (90.0, 20.0))]
)
def test_an_impossible_start_is_refused(field: str, value: tuple[float, float]) -> None:
    with pytest.raises(InvalidValueError, match=field):
        SimulationSettings(**{field: value})

"""Battery, heat, I2t and flux weakening in the engine against the drive that the plant has."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tests.engine.test_engine import options, scattered

from sprintlab.engine import Engine
from sprintlab.motors import Battery, I2tLimit, WindingHeat
from sprintlab.plant import PlantOptions, SuppliedDrive
from sprintlab.robots import load_robot

N = 64
OPTIONS = {
    "flux-weakening": {"motor_model": "flux-weakening"},
    "heat": {"heat": WindingHeat()},
    "battery": {"battery": Battery(internal_resistance=0.15)},
    "i2t": {"i2t": I2tLimit(continuous_current=25.0, peak_duration=3.0)},
}
STATE = ("qpos", "qvel", "winding_temperature", "i2t_level", "state_of_charge", "bus_voltage")
RATES = ("winding_temperature", "i2t_level", "state_of_charge")
OPTIONS["all"] = {name: value for chosen in OPTIONS.values() for name, value in chosen.items()}


@pytest.mark.parametrize("double", [True, False])
@pytest.mark.parametrize(("name", "chosen"), [*(("bp2", chosen) for chosen in OPTIONS), ("bp2-waist", "all")])
def test_the_supply_is_that_of_the_plant(name: str, chosen: str, double: bool) -> None:
    """One turn of the motor loop over random states; both solvers of the bus stop within 0.1 mV."""
    if not double and chosen != "all":
        return
    engine = Engine(load_robot(name), options(N, 1, **OPTIONS[chosen]), "cpu", double=double)
    scattered(engine, 5.0, speed=14.0)
    draw, shape = np.random.default_rng(4), engine.target.shape
    engine.target += torch.tensor(draw.normal(0, 1, shape), dtype=engine.target.dtype)
    engine.winding_temperature += torch.tensor(draw.uniform(0, 100, shape), dtype=engine.target.dtype)
    engine.i2t_level.copy_(torch.tensor(draw.uniform(0, 1, shape)))
    engine.state_of_charge.copy_(torch.tensor(draw.uniform(0.02, 1, N)))
    before = {name: getattr(engine, name).double().numpy().copy() for name in STATE}
    engine.step()
    rows = [
        _turned(engine, OPTIONS[chosen], row, {name: before[name][row] for name in STATE}) for row in range(N)
    ]
    for field in rows[0]:
        theirs, ours = np.array([each[field] for each in rows]), getattr(engine, field).double().numpy()
        if double and field in RATES:
            ours, theirs = ours - before[field], theirs - before[field]
        assert np.allclose(ours, theirs, rtol=1e-5, atol=(2e-5 if double else 1e-4) * np.abs(theirs).max()), (
            field
        )
        assert np.abs(theirs).max() > 0.0


def _turned(engine: Engine, given: dict, row: int, state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What a drive of the plant makes of one robot's state."""
    robot = engine.robot
    drive = SuppliedDrive(robot, PlantOptions(**given))
    drive._temperature, drive._level = state["winding_temperature"], state["i2t_level"]
    drive._charge, drive._bus_voltage = float(state["state_of_charge"]), float(state["bus_voltage"])
    joints = [engine.mj_model.joint(joint) for joint in robot.joint_names]
    position = state["qpos"][[int(joint.qposadr[0]) for joint in joints]]
    velocity = state["qvel"][[int(joint.dofadr[0]) for joint in joints]]
    desired = robot.stiffness * (engine.target[row].double().numpy() - position) - robot.damping * velocity
    found = {"torque": drive(desired, velocity).torque}
    if "heat" in given:
        found["winding_temperature"] = drive.state.winding_temperature
    if "i2t" in given:
        found["i2t_level"] = drive.state.i2t_level
    if "battery" in given:
        found |= {"bus_voltage": drive.state.bus_voltage, "state_of_charge": drive.state.state_of_charge}
    return found

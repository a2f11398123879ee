"""One implementation for NumPy and PyTorch: equal numbers, kept types, nothing that waits for a device."""

import dataclasses

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from sprintlab.motors import (
    MOTOR_MODELS,
    Gear,
    PmsmParameters,
    copper_loss,
    critical_speed,
    desaturate,
    drive_torque,
    electrical_power,
    no_load_speed,
    saturate,
    stack_motors,
    torque_limits,
    voltage_infeasible,
)

GEAR = Gear(ratio=6.0, efficiency=0.95)
SPEEDS = np.linspace(-400.0, 400.0, 41)
TORQUES = np.linspace(-40.0, 40.0, 41)

FUNCTIONS = {
    "limits": lambda motor, torque, speed, model: torque_limits(motor, speed, 60.0, model),
    "infeasible": lambda motor, torque, speed, model: (voltage_infeasible(motor, speed, 60.0),),
    "critical": lambda motor, torque, speed, model: (critical_speed(motor, torque, 60.0, model),),
    "no-load": lambda motor, torque, speed, model: (no_load_speed(motor, torque * torque),),
    "saturate": lambda motor, torque, speed, model: (saturate(motor, torque),),
    "desaturate": lambda motor, torque, speed, model: (desaturate(motor, torque),),
    "copper": lambda motor, torque, speed, model: (copper_loss(motor, torque),),
    "power": lambda motor, torque, speed, model: (electrical_power(motor, torque, speed),),
    "drive": lambda motor, torque, speed, model: drive_torque(motor, GEAR, torque, speed / 6, 60.0, model),
}


@pytest.mark.parametrize("name", FUNCTIONS)
@given(motor=st.from_type(PmsmParameters), model=st.sampled_from(MOTOR_MODELS))
def test_numpy_and_torch_agree(name, motor, model, torch):
    function = FUNCTIONS[name]
    expected = function(motor, TORQUES, SPEEDS, model)
    actual = function(motor, torch.tensor(TORQUES), torch.tensor(SPEEDS), model)
    # Where flux weakening takes the root of a difference of nearly zero, half of the digits are lost.
    near = 1e-6 if model == "flux-weakening" else 1e-9
    for one, other in zip(expected, actual, strict=True):
        assert isinstance(other, torch.Tensor)
        np.testing.assert_allclose(other.numpy(), one, rtol=near, atol=near)


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("model", MOTOR_MODELS)
def test_nothing_looks_into_a_tensor(name, model, surrogate, torch):
    """Tensors of the meta device hold no values: whatever asks for one raises."""
    tensor = torch.zeros(41, device="meta")
    for result in FUNCTIONS[name](surrogate, tensor, tensor, model):
        assert result.device.type == "meta"
        assert result.shape == (41,)


def test_stacked_motors_give_each_joint_its_own_limits(surrogate):
    weak = dataclasses.replace(surrogate, stator_resistance=0.158, q_axis_inductance=84e-6, peak_torque=12.0)
    speeds = np.random.default_rng(0).uniform(-300, 300, (7, 2))
    limits = torque_limits(stack_motors([surrogate, weak]), speeds, 60.0)
    for column, motor in enumerate((surrogate, weak)):
        alone = torque_limits(motor, speeds[:, column], 60.0)
        np.testing.assert_array_equal(np.array(limits)[..., column], alone)

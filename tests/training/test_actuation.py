"""The Warp kernel and the NumPy law are the same law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco_warp")

import warp as wp

from sprintlab.control import pd_torque
from sprintlab.motors import MOTOR_MODELS, drive_torque, phase_voltage_limit
from sprintlab.robots import load_robot, soft_stop_torque
from sprintlab.training.actuation import FRICTION_SPEED, MODEL_CODES, JointDrive, joint_torque_kernel
from sprintlab.training.settings import SimulationSettings
from sprintlab.training.simulation import _joint_drives, training_model

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
    inputs: dict[str, np.ndarray], model: str, substep: int = DELAY
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The kernel's ``control``, ``drive_torque`` and ``on_limit``, each ``(n, 12)``."""
    voltage = phase_voltage_limit(inputs["bus"]).astype(np.float32)
    names = ("stiffness", "damping", "strength", "resistance_factor", "friction_factor")
    targets, delay = (inputs["target"], inputs["previous_target"]), np.full(ENVIRONMENTS, DELAY, np.int32)
    outputs = [wp.zeros((ENVIRONMENTS, 12), dtype=float, device="cpu") for _ in range(3)]
    values = [*(inputs[name] for name in names), voltage, inputs["qpos"], inputs["qvel"]]
    wp.launch(
        joint_torque_kernel,
        dim=(ENVIRONMENTS, 12),
        inputs=[
            wp.array(_joint_drives(ROBOT, MODEL), dtype=JointDrive, device="cpu"),
            *(wp.array(value, dtype=float, device="cpu") for value in targets),
            wp.array(delay, dtype=int, device="cpu"),
            *(wp.array(value, dtype=float, device="cpu") for value in values),
            MODEL_CODES[model],
            substep,
        ],
        outputs=outputs,
        device="cpu",
    )
    control, drive, on_limit = (output.numpy() for output in outputs)
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
    refined, simplified, square = (kernel_torque(inputs, model)[1] for model in MOTOR_MODELS)
    assert np.abs(refined - simplified).max() > 1.0
    assert np.abs(simplified - square).max() > 1.0


def test_the_previous_target_holds_until_the_delay_is_over(inputs: dict[str, np.ndarray]) -> None:
    swapped = {**inputs, "target": inputs["previous_target"], "previous_target": inputs["target"]}
    early, late = (kernel_torque(inputs, "refined", substep)[1] for substep in (DELAY - 1, DELAY))
    assert np.abs(early - late).max() > 1.0
    np.testing.assert_array_equal(early, kernel_torque(swapped, "refined", DELAY)[1])

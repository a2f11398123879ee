"""MuJoCo Playground's step on our motors: compiled by JAX where it is installed, else on doubles.

The doubles stand for ``jax.lax.scan`` and for ``mujoco.mjx``, whose data are immutable and whose steps are
here those of MuJoCo C.
"""

import importlib
import importlib.util
import inspect
from types import ModuleType, SimpleNamespace

import mujoco
import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import drive_torque
from sprintlab.robots import robot_motors

NAMES = ("FL_calf_joint", "FL_hip_joint", "FL_thigh_joint")  # not the motors' order
TARGETS = np.array([1.5, -1.0, 0.8])


class Data:
    """What a step uses of ``mjx.Data``."""

    def __init__(self, model, data):
        self.model, self.data, self.qpos, self.qvel = model, data, data.qpos.copy(), data.qvel.copy()

    def replace(self, ctrl):
        self.data.ctrl[:] = ctrl
        return self


def doubles():
    mjx, jax = ModuleType("mujoco.mjx"), ModuleType("jax")

    def step(model, data):
        mujoco.mj_step(data.model, data.data)
        return Data(data.model, data.data)

    def scan(function, carry, inputs, length):
        for _ in range(length):
            carry, _ = function(carry, None)
        return carry, None

    mjx.step, mjx.put_model, mjx.put_data, mjx.Data, mjx.Model = step, lambda model: model, Data, Data, object
    jax.lax, jax.jit, jax.Array = SimpleNamespace(scan=scan), lambda function, **_: function, np.ndarray
    return {"mujoco.mjx": mjx, "jax": jax}


@pytest.fixture
def stage(on_guest, monkeypatch):
    """The module, on JAX or on the doubles."""
    found = doubles()
    if importlib.util.find_spec("jax") is None:
        monkeypatch.setattr(mujoco, "mjx", found["mujoco.mjx"], raising=False)
    return on_guest("playground", "jax", found)


def legs():
    bodies = "".join(
        f"<body pos='0 {at} 0'><joint name='{name}' axis='0 1 0' damping='3'/>"
        "<geom type='capsule' fromto='0 0 0 0 0 -.3' size='.02' mass='.8' contype='0'/></body>"
        for at, name in enumerate(NAMES)
    )
    drives = "".join(f"<position joint='{name}' kp='100' forcerange='-5 5'/>" for name in NAMES)
    world = f"<worldbody>{bodies}</worldbody><actuator>{drives}</actuator>"
    return mujoco.MjModel.from_xml_string(f"<mujoco><option timestep='0.002'/>{world}</mujoco>")


def test_every_physics_step_goes_through_the_law(stage):
    """Against MuJoCo C with the law between its half steps."""
    model, motors = legs(), robot_motors("go1")
    step = stage.MotorStep(model, motors, stiffness=90.0, damping=1.0)
    data = mujoco.MjData(model)
    data.qvel[:] = 9.0, -14.0, 20.0
    device, start = stage.mjx.put_model(model), stage.mjx.put_data(model, data)
    found = stage.jax.jit(step, static_argnames="n_substeps")(device, start, TARGETS, n_substeps=10)
    expected, limited = mujoco.MjData(model), 0
    expected.qvel[:] = 9.0, -14.0, 20.0
    own = motors.ordered(NAMES)
    for _ in range(10):
        wanted = 90.0 * (TARGETS - expected.qpos) - expected.qvel
        torque = drive_torque(own.motor, own.gear, wanted, expected.qvel, own.bus_voltage).torque
        limited += int(np.any(np.abs(torque) < 0.9 * np.abs(wanted)))
        expected.ctrl[:] = torque
        mujoco.mj_step(model, expected)
    assert limited > 3
    assert np.asarray(found.qpos) == pytest.approx(expected.qpos, abs=2e-4)
    assert np.asarray(found.qvel) == pytest.approx(expected.qvel, abs=2e-2)


def test_the_model_gets_the_rotors_and_the_step_the_signature_of_playgrounds_own(stage):
    model, motors = legs(), robot_motors("go1")
    stage.MotorStep(model, motors, stiffness=90.0, damping=1.0)
    values = motors.parameters(NAMES)
    assert model.dof_armature == pytest.approx(values["rotor_inertia"] * values["gear_ratio"] ** 2)
    assert not model.actuator_forcelimited.any() and not model.dof_damping.any()
    expected = ["model", "data", "action", "n_substeps"]  # of mjx_env.step in Playground 0.2.0
    if importlib.util.find_spec("mujoco_playground") is not None:
        own = importlib.import_module("mujoco_playground._src.mjx_env").step
        expected = list(inspect.signature(own).parameters)
    assert list(inspect.signature(stage.MotorStep.__call__).parameters)[1:] == expected
    with pytest.raises(InvalidValueError, match="FL_calf_joint"):
        stage.MotorStep(model, motors.ordered(["FL_thigh_joint", "FL_calf_joint"]), 90.0, 1.0)

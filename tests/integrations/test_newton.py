"""Newton's actuators: the clamping stage against the law, on Newton where installed, else a stand-in."""

import importlib
import sys
from types import ModuleType

import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import Gear, drive_torque, library_motors, load_library_motor, stack_motors

wp = pytest.importorskip("warp", reason="needs Warp: pip install 'sprintlab[train]'")


class ClampingBase:
    """What the stage uses of Newton 1.8's ``newton.actuators.ClampingBase``: nothing but its name."""


@pytest.fixture
def stage(monkeypatch):
    """The module, on Newton's own base class or on the stand-in."""
    try:
        importlib.import_module("newton.actuators")
    except ImportError:
        actuators = ModuleType("newton.actuators")
        actuators.ClampingBase = ClampingBase
        monkeypatch.setitem(sys.modules, "newton", ModuleType("newton"))
        monkeypatch.setitem(sys.modules, "newton.actuators", actuators)
    monkeypatch.delitem(sys.modules, "sprintlab.integrations.newton", raising=False)
    return importlib.import_module("sprintlab.integrations.newton")


def array(values):
    return wp.array(np.asarray(values, dtype=np.float32), dtype=wp.float32, device="cpu")


def built(stage, arguments):
    """The stage as Newton's builder makes it: numbers of each actuator side by side."""
    resolved = [stage.PmsmClamping.resolve_arguments(given) for given in arguments]
    return stage.PmsmClamping(**{name: array([one[name] for one in resolved]) for name in resolved[0]})


def clamped(clamping, wanted, velocity):
    indices = wp.array(np.arange(len(wanted), dtype=np.uint32), dtype=wp.uint32, device="cpu")
    source, target = array(wanted), wp.zeros(len(wanted), dtype=wp.float32, device="cpu")
    speeds = array(velocity)
    clamping.modify_forces(source, target, speeds, speeds, indices, indices, device="cpu")
    return target.numpy()


@pytest.mark.parametrize("model", ["refined", "simplified-dc"])
def test_the_stage_gives_the_law(stage, model):
    """Every motor of the library at random torques and speeds, over-speed in."""
    random = np.random.default_rng(0)
    found = [load_library_motor(name) for name in library_motors()] * 60
    motor = stack_motors([actuator.motor for actuator in found])
    gear = Gear(
        ratio=np.array([actuator.gear.ratio for actuator in found]),
        efficiency=random.uniform(0.6, 1.0, len(found)),
    )
    bus = np.array([actuator.bus_voltage for actuator in found]) * random.uniform(0.7, 1.1, len(found))
    arguments = [
        {
            "motor": actuator.motor,
            "gear": Gear(ratio=actuator.gear.ratio, efficiency=float(efficiency)),
            "bus_voltage": float(volts),
            "model": model,
        }
        for actuator, efficiency, volts in zip(found, gear.efficiency, bus, strict=True)
    ]
    peak = motor.peak_torque * gear.ratio
    wanted = random.uniform(-2.0, 2.0, len(found)) * peak
    speed = (
        random.uniform(-1.3, 1.3, len(found))
        * bus
        / (motor.pole_pairs * motor.flux_linkage * gear.ratio * 1.8)
    )
    given = clamped(built(stage, arguments), wanted, speed)
    expected = drive_torque(motor, gear, wanted, speed, bus, model).torque
    np.testing.assert_allclose(given / peak, expected / peak, atol=2e-4)
    assert 0.2 < np.mean(np.abs(expected - wanted) > 0.05 * peak) < 0.95


def test_a_single_motor_needs_no_gear_of_another(stage):
    actuator = load_library_motor("mit-mini-cheetah")
    given = {"motor": actuator.motor, "gear": actuator.gear, "bus_voltage": actuator.bus_voltage}
    torque = clamped(built(stage, [given]), [5.0], [3.0])
    expected = drive_torque(actuator.motor, actuator.gear, 5.0, 3.0, actuator.bus_voltage).torque
    assert torque[0] == pytest.approx(float(expected), rel=1e-5)


def test_a_bus_voltage_can_be_changed_in_place(stage):
    actuator = load_library_motor("mit-mini-cheetah")
    clamping = built(stage, [{"motor": actuator.motor, "gear": actuator.gear, "bus_voltage": 24.0}])
    peak = float(actuator.motor.peak_torque * actuator.gear.ratio)
    before = clamped(clamping, [peak], [25.0])[0]
    clamping.bus_voltage.fill_(18.0)
    assert clamped(clamping, [peak], [25.0])[0] < before - 0.05 * peak


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"motor": None}, "motor"),
        ({"bus_voltage": -1.0}, "bus_voltage"),
        ({"model": "square"}, "refined, simplified-dc"),
        ({"gear_ratio": 6.0}, "gear_ratio"),
    ],
)
def test_bad_arguments_are_refused(stage, change, words):
    actuator = load_library_motor("mit-mini-cheetah")
    given = {"motor": actuator.motor, "gear": actuator.gear, "bus_voltage": 24.0} | change
    given = {name: value for name, value in given.items() if value is not None}
    with pytest.raises(InvalidValueError, match=words):
        stage.PmsmClamping.resolve_arguments(given)


def test_newtons_own_actuator_runs_it(stage):
    """A model built, finalized and stepped by Newton itself: PD drive, then this stage."""
    newton = pytest.importorskip("newton", reason="needs Newton 1.8")
    if not hasattr(newton, "ModelBuilder"):
        pytest.skip("needs Newton 1.8")
    from newton.actuators import DrivePD

    actuator = load_library_motor("mit-mini-cheetah")
    given = {"motor": actuator.motor, "gear": actuator.gear, "bus_voltage": actuator.bus_voltage}
    builder = newton.ModelBuilder()
    link = builder.add_link()
    joint = builder.add_joint_revolute(parent=-1, child=link, axis=newton.Axis.Z)
    builder.add_articulation([joint])
    dof = builder.joint_qd_start[joint]
    builder.add_actuator(DrivePD, index=dof, kp=100.0, kd=1.0, clamping=[(stage.PmsmClamping, given)])
    model = builder.finalize(device="cpu")
    state, control = model.state(), model.control()
    state.joint_q.fill_(0.2)
    state.joint_qd.fill_(20.0)
    control.joint_target_q.fill_(1.0)
    control.joint_f.zero_()
    model.actuators[0].step(state, control)
    wanted = 100.0 * 0.8 - 20.0
    expected = drive_torque(actuator.motor, actuator.gear, wanted, 20.0, actuator.bus_voltage).torque
    assert control.joint_f.numpy()[0] == pytest.approx(float(expected), rel=1e-4)
    assert float(expected) < 0.6 * wanted

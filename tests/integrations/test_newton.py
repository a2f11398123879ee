"""Newton's actuators: the clamping stage against the law, on Newton where installed, else a stand-in."""

from types import ModuleType

import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import Gear, drive_torque, library_motors, load_library_motor, stack_motors
from sprintlab.robots import JointMotors, robot_motors

wp = pytest.importorskip("warp", reason="needs Warp: pip install 'sprintlab[train]'")


class ClampingBase:
    """What the stage uses of Newton 1.8's ``newton.actuators.ClampingBase``: nothing but its name."""


@pytest.fixture
def stage(on_guest):
    """The module, on Newton's own base class or on the stand-in."""
    actuators = ModuleType("newton.actuators")
    actuators.ClampingBase = ClampingBase
    doubles = {"newton": ModuleType("newton"), "newton.actuators": actuators}
    return on_guest("newton", "newton.actuators", doubles)


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


def test_the_stage_gives_the_law(stage):
    """Every motor of the library at random torques and speeds, over-speed in."""
    random, bus = np.random.default_rng(0), 40.0
    found = [load_library_motor(name) for name in library_motors()] * 60
    names = tuple(f"joint {at}" for at in range(len(found)))
    motor = stack_motors([actuator.motor for actuator in found])
    gear = Gear(
        ratio=np.array([actuator.gear.ratio for actuator in found]),
        efficiency=random.uniform(0.6, 1.0, len(found)),
    )
    motors = JointMotors(names=names, motor=motor, gear=gear, bus_voltage=bus)
    arguments = [given for _, given in stage.pmsm_clampings(names, motors).values()]
    peak = motor.peak_torque * gear.ratio
    wanted = random.uniform(-2.0, 2.0, len(found)) * peak
    no_load = bus / (motor.pole_pairs * motor.flux_linkage * gear.ratio * 1.8)
    speed = random.uniform(-1.3, 1.3, len(found)) * no_load
    given = clamped(built(stage, arguments), wanted, speed)
    expected = drive_torque(motor, gear, wanted, speed, bus).torque
    np.testing.assert_allclose(given / peak, expected / peak, atol=2e-4)
    assert 0.2 < np.mean(np.abs(expected - wanted) > 0.05 * peak) < 0.95


def cheetah(stage):
    """One motor's clamping stage, and the motor."""
    found = load_library_motor("mit-mini-cheetah")
    motors = JointMotors(motor=found.motor, gear=found.gear, bus_voltage=found.bus_voltage)
    return found, stage.pmsm_clampings(["any"], motors)["any"]


def test_motors_are_found_by_joint_name(stage):
    """Two calves and a thigh of the Go1, in an order that is not its own."""
    names, motors = ["RR_calf_joint", "FL_thigh_joint", "FR_calf_joint"], robot_motors("go1")
    given = stage.pmsm_clampings(names, motors)
    wanted, speed = np.array([80.0, 60.0, -70.0]), np.array([12.0, 20.0, -14.0])
    torque = clamped(built(stage, [given[name][1] for name in names]), wanted, speed)
    own = motors.ordered(names)
    expected = drive_torque(own.motor, own.gear, wanted, speed, own.bus_voltage).torque
    assert torque == pytest.approx(expected, rel=1e-4)
    with pytest.raises(InvalidValueError, match="tail"):
        stage.pmsm_clampings(["tail"], motors)
    clamping, arguments = given[names[0]]
    for wrong in (arguments | {"size": 1.0}, {"gear_ratio": 6.0}):
        with pytest.raises(InvalidValueError, match="PmsmClamping"):
            clamping.resolve_arguments(wrong)


def test_newtons_own_actuator_runs_it(stage):
    """A model built, finalized and stepped by Newton itself: PD drive, then this stage."""
    newton = pytest.importorskip("newton", reason="needs Newton 1.8")
    if not hasattr(newton, "ModelBuilder"):
        pytest.skip("needs Newton 1.8")
    from newton.actuators import DrivePD

    actuator, given = cheetah(stage)
    builder = newton.ModelBuilder()
    link = builder.add_link()
    joint = builder.add_joint_revolute(parent=-1, child=link, axis=newton.Axis.Z)
    builder.add_articulation([joint])
    dof = builder.joint_qd_start[joint]
    builder.add_actuator(DrivePD, index=dof, kp=100.0, kd=1.0, clamping=[given])
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

"""What training runs in every step fits into one CUDA graph: no value read, no constant made, on the host."""

import numpy as np
import pytest
from tests.commands.test_schedules import SCHEDULES, draw_inputs

from sprintlab.commands import CommandStep, initial_state, ranked_speeds
from sprintlab.control import (
    LowPass,
    Measurement,
    ObservationLayout,
    join_proprioception,
    joint_targets,
    network_input,
    observation_frame,
    pd_torque,
    projected_gravity,
    split_proprioception,
    update_history,
)

torch = pytest.importorskip("torch")
dispatch = pytest.importorskip("torch.utils._python_dispatch")

SHAPES = {"quaternion": (4,), "rate": (3,), "joints": (12,), "filtered": (30,), "history": (5, 45)}


class NoHostConstants(dispatch.TorchDispatchMode):
    """Refuses every tensor made from Python data, which a capture would have to copy from the host.

    Together with the meta device, which has no values, so that reading one on the host fails by itself.
    """

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        if function is torch.ops.aten.lift_fresh.default:
            raise AssertionError("a constant was copied from the host")
        return function(*args, **(kwargs or {}))


@pytest.mark.parametrize("schedule", SCHEDULES, ids=lambda schedule: type(schedule).__name__)
def test_a_step_reads_no_value_and_makes_no_constant_on_the_host(schedule):
    """One policy step of a training environment without its physics."""
    drawn = draw_inputs(np.random.default_rng(0), 64)
    drawn |= {name: np.ones((64, *shape)) for name, shape in SHAPES.items()}
    tensors = {name: torch.from_numpy(value).to("meta") for name, value in drawn.items()}
    quaternion, rate, joints, filtered, history = (tensors.pop(name) for name in SHAPES)
    with NoHostConstants():
        raw = Measurement(rate, projected_gravity(quaternion), joints, joints)
        filtered = LowPass().step(filtered, join_proprioception(raw), tensors["reset_mask"])
        step = CommandStep(dt=0.02, lower=-2.0, upper=9.0, **tensors)
        state = schedule.advance(initial_state(64, tensors["speed"]), step)
        measured = split_proprioception(filtered)
        frame = observation_frame(ObservationLayout(), measured, state.command, joints)
        history = update_history(history, frame, tensors["reset_mask"])
        torque = pd_torque(joints, joints, joint_targets(joints, joints, joints, 10.0), joints, joints)
        results = *state, network_input(history), torque, *ranked_speeds(tensors["speed"], (0.5, 0.999))
    assert {result.device.type for result in results} == {"meta"}

"""What training runs in every step fits into one CUDA graph."""

import numpy as np
import pytest

from sprintlab.commands import (
    AdaptiveSchedule,
    CommandStep,
    FixedAccelerationSchedule,
    UniformSchedule,
    initial_state,
    ranked_speeds,
)
from sprintlab.control import (
    LowPass,
    ObservationLayout,
    Proprioception,
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

ENVIRONMENTS = 64
SHAPES = {
    "quaternion": (4,),
    "angular_velocity": (3,),
    "joint_position": (12,),
    "joint_velocity": (12,),
    "action": (12,),
    "gains": (12,),
    "filtered": (30,),
    "history": (5, 45),
    "speed": (),
    "friction": (),
    "reset_mask": (),
    "random": (8,),
}
SCHEDULES = (AdaptiveSchedule(), UniformSchedule(), FixedAccelerationSchedule())


class NoHostConstants(dispatch.TorchDispatchMode):
    """Refuses every tensor made from Python data, which a capture would have to copy from the host.

    Together with the meta device, which has no values, so that reading one on the host fails by itself.
    """

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        if function is torch.ops.aten.lift_fresh.default:
            raise AssertionError("a constant was copied from the host")
        return function(*args, **(kwargs or {}))


def draw_inputs():
    generator = np.random.default_rng(0)
    inputs = {name: generator.random((ENVIRONMENTS, *shape), np.float32) for name, shape in SHAPES.items()}
    inputs["reset_mask"] = inputs["reset_mask"] < 0.2
    return inputs


def one_step(schedule, state, inputs):
    """One policy step of a training environment without its physics."""
    raw = Proprioception(
        inputs["angular_velocity"],
        projected_gravity(inputs["quaternion"]),
        inputs["joint_position"],
        inputs["joint_velocity"],
    )
    filtered = LowPass().step(inputs["filtered"], join_proprioception(raw), inputs["reset_mask"])
    arguments = {name: inputs[name] for name in ("speed", "friction", "reset_mask", "random")}
    state = schedule.advance(state, CommandStep(dt=0.02, lower=-2.0, upper=9.0, **arguments))
    frame = observation_frame(
        ObservationLayout(),
        **split_proprioception(filtered)._asdict(),
        command=state.command,
        previous_action=inputs["action"],
    )
    history = update_history(inputs["history"], frame, inputs["reset_mask"])
    target = joint_targets(inputs["action"], inputs["gains"], inputs["gains"], 10.0)
    torque = pd_torque(
        inputs["gains"], inputs["gains"], target, inputs["joint_position"], inputs["joint_velocity"]
    )
    return *state, network_input(history), torque, *ranked_speeds(inputs["speed"], (0.5, 0.95, 0.999))


@pytest.mark.parametrize("schedule", SCHEDULES, ids=lambda schedule: type(schedule).__name__)
def test_a_step_reads_no_value_and_makes_no_constant_on_the_host(schedule):
    inputs = {name: torch.from_numpy(value).to("meta") for name, value in draw_inputs().items()}
    with NoHostConstants():
        results = one_step(schedule, initial_state(ENVIRONMENTS, inputs["speed"]), inputs)
    assert {result.device.type for result in results} == {"meta"}


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("schedule", SCHEDULES, ids=lambda schedule: type(schedule).__name__)
def test_a_captured_step_equals_numpy(schedule):
    inputs = draw_inputs()
    expected = one_step(schedule, initial_state(ENVIRONMENTS, inputs["speed"]), inputs)
    tensors = {name: torch.from_numpy(value).cuda() for name, value in inputs.items()}
    state = initial_state(ENVIRONMENTS, tensors["speed"])
    one_step(schedule, state, tensors)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        results = one_step(schedule, state, tensors)
    graph.replay()
    for result, reference in zip(results, expected, strict=True):
        np.testing.assert_allclose(result.cpu().numpy(), reference, rtol=1e-5, atol=1e-5)

"""Policies small enough to build in a test: a linear map of the observation to the action."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from sprintlab.control import (
    CONTRACT_KEY,
    LowPass,
    ObservationLayout,
    TrainingRecord,
    encode_contract,
    make_contract,
)
from sprintlab.robots import RobotDescription, load_robot

RECORD = TrainingRecord(
    method="test",
    actuator_model="refined",
    command_line="none",
    config_hash="0" * 64,
    seed=0,
    iterations=0,
    environment_steps=0,
    device="none",
    date="2026-01-01T00:00:00",
)


@pytest.fixture(scope="session")
def robot() -> RobotDescription:
    return load_robot("bp2")


@pytest.fixture(scope="session")
def make_policy(
    robot: RobotDescription, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[np.ndarray], Path]:
    """Write a policy that always gives the same action ``(12,)``."""

    def write(action: np.ndarray) -> Path:
        layout = ObservationLayout()
        weights = numpy_helper.from_array(np.zeros((layout.input_size, 12), np.float32), "weights")
        bias = numpy_helper.from_array(np.asarray(action, np.float32), "bias")
        graph = helper.make_graph(
            [helper.make_node("Gemm", ["observation", "weights", "bias"], ["action"])],
            "policy",
            [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["batch", layout.input_size])],
            [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["batch", 12])],
            [weights, bias],
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        contract = make_contract(
            robot, layout=layout, training=RECORD, software={}, proprioception_filter=LowPass()
        )
        helper.set_model_props(model, {CONTRACT_KEY: encode_contract(contract)})
        path = tmp_path_factory.mktemp("policy") / "tiny.onnx"
        onnx.save(model, path)
        return path

    return write


@pytest.fixture(scope="session")
def standing_policy(make_policy: Callable[[np.ndarray], Path]) -> Path:
    """Zero action: the default pose, which stands."""
    return make_policy(np.zeros(12))

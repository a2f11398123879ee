"""Tiny policies: one matrix, written with the onnx package as an export would write it."""

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
    software_versions,
)
from sprintlab.robots import load_robot


@pytest.fixture(scope="session")
def robot():
    return load_robot("bp2")


@pytest.fixture(scope="session")
def contract(robot):
    training = TrainingRecord(
        method="sprint",
        actuator_model="refined",
        command_line="sprintlab train --seed 3",
        config_hash="0" * 64,
        seed=3,
        iterations=10,
        environment_steps=1000,
        device="CPU",
        date="2025-01-01T00:00:00+00:00",
    )
    return make_contract(
        robot,
        layout=ObservationLayout(),
        training=training,
        software=software_versions("numpy"),
        proprioception_filter=LowPass(),
    )


@pytest.fixture(scope="session")
def weights():
    return np.random.default_rng(0).normal(scale=0.3, size=(225, 12)).astype(np.float32)


@pytest.fixture
def write_policy(tmp_path, contract, weights):
    """Write an ONNX file ``action = observation @ weights``; what is given replaces the sound part."""

    def write(*, metadata=None, matrix=None, batch="batch", names=("observation", "action")):
        matrix = weights if matrix is None else matrix
        inputs, outputs = (
            helper.make_tensor_value_info(name, TensorProto.FLOAT, [batch, size])
            for name, size in zip(names, matrix.shape, strict=True)
        )
        node = helper.make_node("MatMul", [names[0], "weights"], [names[1]])
        graph = helper.make_graph(
            [node], "policy", [inputs], [outputs], [numpy_helper.from_array(matrix, "weights")]
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
        if metadata is None:
            metadata = {CONTRACT_KEY: encode_contract(contract)}
        helper.set_model_props(model, metadata)
        path = tmp_path / "policy.onnx"
        onnx.save(model, path)
        return path

    return write

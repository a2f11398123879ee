"""Tiny policies: one matrix, in a file as an export would write it."""

import numpy as np
import pytest

from sprintlab.control import CONTRACT_KEY, encode_contract


@pytest.fixture(scope="session")
def weights():
    return np.random.default_rng(0).normal(scale=0.3, size=(225, 12)).astype(np.float32)


@pytest.fixture
def write_policy(tmp_path, contract, weights, save_network):
    """Write an ONNX file ``action = observation @ weights``; what is given replaces the sound part."""

    def write(*, metadata=None, matrix=None, batch="batch", names=("observation", "action")):
        matrix = weights if matrix is None else matrix
        observation, action = names
        return save_network(
            tmp_path / "policy.onnx",
            [("MatMul", observation, "weights", action)],
            {"weights": matrix},
            inputs={observation: matrix.shape[0]},
            outputs={action: matrix.shape[1]},
            metadata={CONTRACT_KEY: encode_contract(contract)} if metadata is None else metadata,
            batch=batch,
        )

    return write

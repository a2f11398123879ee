"""Tiny policies: one matrix, in a file as an export would write it."""

import json

import msgspec
import numpy as np
import pytest

from sprintlab.control import CONTRACT_KEY, Measurement, PolicyRuntime, encode_contract, load_policy
from sprintlab.control.contract import decode_contract
from sprintlab.control.observation import observation_frame
from sprintlab.core.errors import PolicyFileError


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


@pytest.fixture
def assert_carried(contract):
    """Check that a part of the contract is written and read, refused where it is impossible, and optional."""

    def check(name, part, impossible):
        changed = msgspec.structs.replace(contract, **{name: part})
        assert decode_contract(encode_contract(changed)) == changed
        fields = json.loads(encode_contract(changed))
        with pytest.raises(PolicyFileError, match=name):
            decode_contract(json.dumps({**fields, name: impossible}))
        del fields[name]
        assert getattr(decode_contract(json.dumps(fields)), name) is None

    return check


@pytest.fixture
def watched_runtime(write_policy, contract, robot, monkeypatch):
    """A runtime whose contract is changed, a robot that stands still, and the commands its network gets."""

    def make(**changes):
        seen = []
        monkeypatch.setattr(
            "sprintlab.control.policy.observation_frame",
            lambda layout, **terms: seen.append(terms["command"]) or observation_frame(layout, **terms),
        )
        changed = {CONTRACT_KEY: encode_contract(msgspec.structs.replace(contract, **changes))}
        pose = np.asarray(robot.default_pose, dtype=float)
        still = Measurement(np.zeros(3), np.array([0.0, 0.0, -1.0]), pose, np.zeros(pose.size))
        return PolicyRuntime(load_policy(write_policy(metadata=changed)), robot), still, seen

    return make

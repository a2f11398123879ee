"""Policies with an estimator: their own last estimate comes back to them as an input."""

import msgspec
import numpy as np
import pytest

from sprintlab.control import (
    CONTRACT_KEY,
    ESTIMATE_SIZE,
    Measurement,
    PolicyRuntime,
    encode_contract,
    load_policy,
)
from sprintlab.control.standing import StandingContract
from sprintlab.core.errors import PolicyFileError

COEFFICIENT = 0.25


@pytest.fixture
def estimator_contract(contract):
    filters = msgspec.structs.replace(contract.filters, estimate_cutoff_hz=3.0)
    return msgspec.structs.replace(contract, filters=filters)


@pytest.fixture
def matrices():
    generator = np.random.default_rng(5)
    shapes = {"perceive": (225, ESTIMATE_SIZE), "act": (ESTIMATE_SIZE, 12)}
    return {name: generator.normal(scale=0.1, size=shape) for name, shape in shapes.items()}


@pytest.fixture
def write_estimator(tmp_path, estimator_contract, matrices, save_network):
    """estimate = previous + 0.25 (observation @ perceive - previous); action = estimate @ act."""

    def write(described=None, outputs=("action", "estimate")):
        nodes = [
            ("MatMul", "observation", "perceive", "raw"),
            ("Sub", "raw", "previous_estimate", "change"),
            ("Mul", "change", "coefficient", "part"),
            ("Add", "previous_estimate", "part", "estimate"),
            ("MatMul", "estimate", "act", "action"),
        ]
        sizes = {"action": 12, "estimate": ESTIMATE_SIZE}
        return save_network(
            tmp_path / "estimator.onnx",
            nodes,
            {**matrices, "coefficient": np.array(COEFFICIENT)},
            inputs={"observation": 225, "previous_estimate": ESTIMATE_SIZE},
            outputs={name: sizes[name] for name in outputs},
            metadata={CONTRACT_KEY: encode_contract(described or estimator_contract)},
        )

    return write


@pytest.fixture
def measurements():
    generator = np.random.default_rng(6)
    return [Measurement(*(generator.normal(size=size) for size in (3, 3, 12, 12))) for _ in range(6)]


def test_the_runtime_hands_the_estimate_back(write_estimator, robot, measurements, matrices):
    loaded = load_policy(write_estimator())
    runtime = PolicyRuntime(loaded, robot)
    assert loaded.estimates and runtime.last_estimate is None
    seen, expected = [], np.zeros(ESTIMATE_SIZE)
    decide = loaded.decide
    loaded.decide = lambda observation, previous: seen.append(observation) or decide(observation, previous)
    for measurement in measurements:
        runtime.step(measurement, np.array([1.0, 0.0, 0.0]))
        expected = expected + COEFFICIENT * (seen[-1][0] @ matrices["perceive"] - expected)
        np.testing.assert_allclose(runtime.last_estimate, expected, rtol=1e-4, atol=1e-5)
        action = expected @ matrices["act"]
        np.testing.assert_allclose(runtime.previous_action, action, rtol=1e-4, atol=1e-5)


def test_a_robot_that_nearly_stands_is_held_in_its_default_pose(
    write_estimator, robot, measurements, estimator_contract
):
    standing = StandingContract(hold_speed=100.0, release_tilt=1.5)
    contract = msgspec.structs.replace(estimator_contract, standing=standing)
    plain = PolicyRuntime(load_policy(write_estimator()), robot)
    held = PolicyRuntime(load_policy(write_estimator(described=contract)), robot)
    pose = np.asarray(contract.default_pose)
    upright = measurements[0]._replace(projected_gravity=np.array([0.0, 0.0, -1.0]))
    for command in (np.array([1.0, 0.0, 0.0]), np.zeros(3)):
        own, blended = (runtime.step(upright, command) for runtime in (plain, held))
        share = 1.0 if command.any() else np.exp(-1.0 / (50.0 * standing.blend_time))
        np.testing.assert_allclose(blended, pose + share * (own - pose), rtol=1e-5, atol=1e-6)


def test_contract_and_network_must_agree_on_the_estimator(write_estimator, contract):
    with pytest.raises(PolicyFileError, match="input must be observation"):
        load_policy(write_estimator(described=contract))
    with pytest.raises(PolicyFileError, match=r"output must be action .*estimate"):
        load_policy(write_estimator(outputs=("action",)))

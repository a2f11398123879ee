"""The forward command falls no faster than the policy's contract allows."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from sprintlab.control import Measurement, PolicyRuntime, load_policy
from sprintlab.control.braking import BrakingContract, limit_braking
from sprintlab.control.contract import CONTRACT_KEY, PolicyContract, decode_contract, encode_contract
from sprintlab.control.observation import observation_frame
from sprintlab.core.errors import InvalidValueError, PolicyFileError
from sprintlab.robots import RobotDescription

LIMITS = BrakingContract(power=30.0, deceleration=5.0)


@pytest.mark.parametrize(
    ("previous", "asked", "expected"),
    [
        (10.0, 0.0, 9.94),  # 30 W/kg at 10 m/s: 3 m/s^2, at 50 Hz
        (5.0, 0.0, 4.9),  # 6 m/s^2 would be within the power: the deceleration decides
        (10.0, 9.95, 9.95),  # slower than the limit: as asked
        (10.0, 12.0, 12.0),  # a rise is never limited
        (0.05, -2.0, -0.05),  # through zero, and on at the same rate
        (0.05, 0.0, 0.0),
        (-2.0, 0.0, -1.9),  # backward, the mirror image
        (-2.0, -3.0, -3.0),
        (0.0, -2.0, -2.0),
    ],
)
def test_only_the_fall_is_limited(previous: float, asked: float, expected: float) -> None:
    assert limit_braking(LIMITS, previous, asked, 50.0) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("field", "value"),
    [("power", 0.0), ("power", 1e6), ("deceleration", -1.0), ("deceleration", float("inf"))],
)
def test_impossible_limits_are_refused(field: str, value: float) -> None:
    with pytest.raises(InvalidValueError, match=f"braking.{field}"):
        BrakingContract(**{field: value})


def test_the_contract_carries_them(contract: PolicyContract) -> None:
    limited = msgspec.structs.replace(contract, braking=LIMITS)
    assert decode_contract(encode_contract(limited)) == limited
    fields = json.loads(encode_contract(limited))
    with pytest.raises(PolicyFileError, match="braking"):
        decode_contract(json.dumps({**fields, "braking": {"power": 0.0}}))
    del fields["braking"]
    assert decode_contract(json.dumps(fields)).braking is None


def test_the_network_sees_the_limited_command(
    write_policy: Callable[..., Path],
    contract: PolicyContract,
    robot: RobotDescription,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[float] = []
    monkeypatch.setattr(
        "sprintlab.control.policy.observation_frame",
        lambda layout, **terms: seen.append(float(terms["command"][0])) or observation_frame(layout, **terms),
    )
    limited = {CONTRACT_KEY: encode_contract(msgspec.structs.replace(contract, braking=LIMITS))}
    runtime = PolicyRuntime(load_policy(write_policy(metadata=limited)), robot)
    pose = np.asarray(robot.default_pose, dtype=float)
    still = Measurement(np.zeros(3), np.array([0.0, 0.0, -1.0]), pose, np.zeros(pose.size))
    for speed in (0.3, 0.0, 0.0, 0.0, 0.0):
        runtime.step(still, np.array([speed, 0.0, 0.0]))
    assert seen == pytest.approx([0.3, 0.2, 0.1, 0.0, 0.0])
    runtime.step(still, np.array([9.0, 0.0, 0.0]))
    runtime.reset()
    runtime.step(still, np.zeros(3))
    assert seen[5:] == pytest.approx([9.0, 0.0])

"""Policies small enough to build in a test: a linear map of the observation to the action."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from sprintlab.control import CONTRACT_KEY, ESTIMATE_SIZE, PolicyContract, encode_contract
from sprintlab.evaluation.audit import audit_trials
from sprintlab.evaluation.results import Trajectory, TrialMetrics, TrialResult
from sprintlab.plant import TrialSettings
from sprintlab.robots import RobotDescription


@pytest.fixture(scope="session")
def make_policy(
    contract: PolicyContract, save_network: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[np.ndarray], Path]:
    """Write a policy that always gives the same action ``(12,)``."""

    def write(action: np.ndarray) -> Path:
        size = contract.layout.input_size
        return save_network(
            tmp_path_factory.mktemp("policy") / "tiny.onnx",
            [("Gemm", "observation", "weights", "bias", "action")],
            {"weights": np.zeros((size, 12)), "bias": action},
            inputs={"observation": size},
            outputs={"action": 12},
            metadata={CONTRACT_KEY: encode_contract(contract)},
        )

    return write


@pytest.fixture(scope="session")
def estimating_policy(
    contract: PolicyContract, save_network: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Stands, and estimates rest at 0.5 m on four feet: half of the way there at every step, from zero."""
    size = contract.layout.input_size
    filters = msgspec.structs.replace(contract.filters, estimate_cutoff_hz=3.0)
    estimating = msgspec.structs.replace(contract, filters=filters)
    return save_network(
        tmp_path_factory.mktemp("policy") / "estimating.onnx",
        [
            ("MatMul", "observation", "still", "action"),
            ("Add", "previous_estimate", "rest", "sum"),
            ("Mul", "sum", "half", "estimate"),
        ],
        {
            "still": np.zeros((size, 12)),
            "rest": np.array([[0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 1.0]]),
            "half": np.array(0.5),
        },
        inputs={"observation": size, "previous_estimate": ESTIMATE_SIZE},
        outputs={"action": 12, "estimate": ESTIMATE_SIZE},
        metadata={CONTRACT_KEY: encode_contract(estimating)},
    )


@pytest.fixture(scope="session")
def standing_policy(make_policy: Callable[[np.ndarray], Path]) -> Path:
    """Zero action: the default pose, which stands."""
    return make_policy(np.zeros(12))


@pytest.fixture
def make_trajectory(robot: RobotDescription) -> Callable[..., Trajectory]:
    """A trajectory at rest with all feet on the ground; any array can be replaced."""

    def build(seconds: float = 4.0, **arrays: np.ndarray) -> Trajectory:
        time = np.arange(round(seconds * 500)) / 500.0
        count = len(time)
        qpos = np.zeros((count, 23))
        qpos[:, 3] = 1.0
        still: dict[str, np.ndarray] = {
            "time": time,
            "qpos": qpos,
            "qvel": np.zeros((count, 22)),
            "profile_speed": np.ones(count),
            "command": np.tile([1.0, 0.0, 0.0], (count, 1)),
            "velocity": np.zeros((count, 2)),
            "angular_velocity": np.zeros((count, 3)),
            "heading": np.zeros(count),
            "foot_contact": np.ones((count, 4), dtype=bool),
            "foot_penetration": np.zeros((count, 4)),
            "foot_position": np.zeros((count, 4, 3)),
            "foot_slip_speed": np.zeros((count, 4)),
            "leg_distance": np.full(count, 0.2),
        }
        joints = ("joint_position", "joint_velocity", "joint_target", "motor_torque", "joint_torque")
        still |= {name: np.zeros((count, 12)) for name in joints}
        still |= {"torque_lower": np.full((count, 12), -1.0), "torque_upper": np.full((count, 12), 1.0)}
        return Trajectory(**{**still, **arrays})

    return build


def metrics_with(**values: Any) -> TrialMetrics:
    """Metrics of a good run at 10 m/s; any field can be replaced."""
    good: dict[str, Any] = {
        "held_speed": 10.0,
        "hold_acceleration": 0.05,
        "peak_speed": 10.2,
        "angular_cost": 2.0,
        "lateral_deviation": 0.1,
        "envelope_share": (0.1,) * 12,
        "mechanical_power": 1000.0,
        "copper_power": 400.0,
        "electrical_power": 1400.0,
        "cost_of_transport": 0.4,
        "distance": 80.0,
        "stride_frequency": 6.0,
        "duty_factor": (0.15,) * 4,
        "mean_duty": 0.15,
        "stance_time": 0.025,
        "touchdowns_per_stride": 1.0,
        "foot_force": 2.5,
        "gear_torque_ratio": (1.5,) * 12,
        "joint_speed_ratio": (0.9,) * 12,
        "pad_deflection": 0.006,
        "smallest_leg_distance": 0.05,
        "slip_per_step": 0.01,
        "final_speed": 0.02,
        "lane_excursion": 0.3,
        "line_winding_temperature": 70.0,
    }
    return TrialMetrics(**{**good, **values})


@pytest.fixture
def make_metrics() -> Callable[..., TrialMetrics]:
    return metrics_with


@pytest.fixture
def make_trial() -> Callable[..., TrialResult]:
    """A finished trial without a trajectory."""

    def build(top_speed: float = 10.0, completed: bool = True, **values: Any) -> TrialResult:
        metrics = metrics_with(**values)
        return TrialResult(
            settings=TrialSettings(),
            top_speed=top_speed,
            self_paced=False,
            completed=completed,
            fall_time=None if completed else 3.0,
            fall_reason="" if completed else "tilt",
            hold_interval=(3.5, 7.5),
            metrics=metrics,
            audit=audit_trials([metrics]),
        )

    return build

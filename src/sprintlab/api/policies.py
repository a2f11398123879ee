"""Policies and the robots they drive, by name or by file."""

from __future__ import annotations

import os
from pathlib import Path

from sprintlab import control
from sprintlab.api.results import Result, exit_if_worker, records
from sprintlab.control import Policy, check_contract, shipped_policies, shipped_policy
from sprintlab.core.arguments import checked
from sprintlab.core.errors import SprintlabError
from sprintlab.evaluation.pool import TrialPool
from sprintlab.robots import RobotDescription, load_robot, robot_names

PolicyChoice = str | Path
"""A policy file, or the name of a policy that comes with the package."""
RobotChoice = str | Path | None
"""Name, folder or table of a robot; ``None`` takes that of the policy's contract."""


def policies() -> Result:
    """The policies that come with the package, with what their contracts say."""
    found = {}
    for name, path in shipped_policies().items():
        contract = load_policy(path).contract
        found[name] = {"robot": contract.robot_name, "method": contract.training.method, "path": str(path)}
    rows = [{"name": name, **numbers} for name, numbers in found.items()]
    return Result(numbers=found, shown=[records("Policies", rows)])


@checked
def load_policy(policy: PolicyChoice) -> Policy:
    """A policy by the path of its file, or by the name of one that comes with the package.

    Raises:
        PolicyFileError: there is no such policy, or the file is not a policy.
        ContractMismatchError: it sees or estimates what this version does not build.
    """
    return control.load_policy(policy_path(policy))


def policy_path(policy: PolicyChoice) -> Path:
    """The file of a policy: a name of the package comes before a file of the same name."""
    if isinstance(policy, Path):
        return policy
    is_path = policy.endswith(".onnx") or bool({"/", "\\"} & set(policy)) or os.path.exists(policy)
    return Path(policy) if is_path and policy not in shipped_policies() else shipped_policy(policy)


def open_policy(policy: PolicyChoice, robot: RobotChoice) -> tuple[Path, Policy, RobotDescription]:
    """A policy with its file, and the robot that was asked for or else that of its contract."""
    exit_if_worker()
    path = policy_path(policy)
    loaded = control.load_policy(path)
    described = load_robot(robot or known_robot(loaded.contract.robot_name, path.name))
    check_contract(loaded.contract, described)
    return path, loaded, described


def trial_pool(policy: PolicyChoice, robot: RobotChoice, workers: int | None) -> TrialPool:
    """Processes for trials of a policy on its robot."""
    path, _, described = open_policy(policy, robot)
    return TrialPool(path, described, workers)


def default_robot() -> str:
    """The robot where neither a robot nor a policy is named: that of the package's standard policy."""
    return known_robot(load_policy(shipped_policy()).contract.robot_name, "sprint")


def known_robot(robot: str, name: str) -> str:
    """A robot that a file names; ``name`` is the file's. It must be a name: no file chooses a path."""
    if robot not in robot_names():
        raise SprintlabError(
            f"{name} is for robot {robot!r}, unknown here: name its folder or table with --robot"
        )
    return robot

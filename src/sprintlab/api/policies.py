"""Policies and the robots they drive, by name or by file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from sprintlab.api.results import Result, leave_to_the_parent, table
from sprintlab.core.arguments import checked
from sprintlab.core.errors import SprintlabError

if TYPE_CHECKING:
    from sprintlab.control import Policy
    from sprintlab.evaluation.pool import TrialPool

PolicyChoice = str | Path
"""A policy file, or the name of a policy that comes with the package."""
RobotChoice = str | Path | None
"""Name, folder or table of a robot; ``None`` takes that of the policy's contract."""


def policies() -> Result:
    """The policies that come with the package, with what their contracts say."""
    from sprintlab.control import shipped_policies

    found = {}
    for name, path in shipped_policies().items():
        contract = load_policy(path).contract
        found[name] = {"robot": contract.robot_name, "method": contract.training.method, "path": str(path)}
    rows = ((name, each["robot"], each["method"]) for name, each in found.items())
    return Result(numbers=found, shown=[table("Policies", "name", "robot", "method", rows=rows)])


@checked
def load_policy(policy: PolicyChoice) -> Policy:
    """A policy by the path of its file, or by the name of one that comes with the package.

    Raises:
        PolicyFileError: there is no such policy, or the file is not a policy.
        ContractMismatchError: it sees or estimates what this version does not build.
    """
    from sprintlab.control import load_policy as read

    return read(policy_path(policy))


def policy_path(policy: PolicyChoice) -> Path:
    """The file of a policy: a name of the package comes before a file of the same name.

    Raises:
        PolicyFileError: there is no such policy.
    """
    from sprintlab.control import shipped_policies, shipped_policy

    if isinstance(policy, Path):
        return policy
    is_path = policy.endswith(".onnx") or bool({"/", "\\"} & set(policy)) or os.path.exists(policy)
    return Path(policy) if is_path and policy not in shipped_policies() else shipped_policy(policy)


def policy_and_robot(policy: PolicyChoice, robot: RobotChoice) -> tuple[Path, str | Path]:
    """The file of a policy, and the robot that was asked for or else that of its contract.

    Raises:
        PolicyFileError: there is no such policy.
        SprintlabError: the contract names a robot that is not known here.
    """
    leave_to_the_parent()
    path = policy_path(policy)
    return path, robot or robot_of(load_policy(path), path.name)


def trial_pool(policy: PolicyChoice, robot: RobotChoice, workers: int | None) -> TrialPool:
    """Processes for trials of a policy on the robot that was asked for, or else on its contract's.

    Raises:
        SprintlabError: the policy, the robot or the number of processes is refused.
    """
    from sprintlab.evaluation.pool import TrialPool
    from sprintlab.robots import load_robot

    path, robot = policy_and_robot(policy, robot)
    return TrialPool(path, load_robot(robot), workers)


def robot_of(policy: Policy, name: str) -> str:
    """The robot that the contract of a policy names; ``name`` is the policy's, for the message.

    Raises:
        SprintlabError: that robot is not known here.
    """
    return known_robot(policy.contract.robot_name, name)


def default_robot() -> str:
    """The robot where neither a robot nor a policy is named: that of the package's standard policy."""
    from sprintlab.control import shipped_policy

    return robot_of(load_policy(shipped_policy()), "sprint")


def known_robot(robot: str, name: str) -> str:
    """A robot that a file names; ``name`` is the file's. It must be a name: no file chooses a path.

    Raises:
        SprintlabError: that robot is not known here.
    """
    from sprintlab.robots import robot_names

    if robot not in robot_names():
        raise SprintlabError(
            f"{name} is for robot {robot!r}, unknown here: name its folder or table with --robot"
        )
    return robot

"""Policies and the robots they drive, by name or by file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.tables import Printed, plain_table
from sprintlab.core.arguments import checked
from sprintlab.core.errors import ContractMismatchError, SprintlabError

if TYPE_CHECKING:
    from sprintlab.control import Policy
    from sprintlab.evaluation.pool import TrialPool

PolicyChoice = str | Path
"""A policy file, or the name of a policy that comes with the package."""
RobotChoice = str | Path | None
"""Name, folder or table of a robot; ``None`` takes that of the policy's contract."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class OfAPolicy(Printed):
    """What was measured of a policy.

    Attributes:
        policy: its name.
        found: the numbers.
        notes: what differs from the published numbers' plant.
    """

    policy: str
    found: Any
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain values, keys with units; what is undefined is None."""
        return {"policy": self.policy, **self.found.to_dict(), "notes": list(self.notes)}


def policy_path(policy: PolicyChoice) -> Path:
    """A policy that comes with the package by name, which no file's name hides, or else a file by path.

    Raises:
        PolicyFileError: there is no such policy.
    """
    from sprintlab.control import shipped_policies, shipped_policy

    if isinstance(policy, Path):
        return policy
    has_folder = "\\" in policy or "/" in policy
    is_path = policy.endswith(".onnx") or has_folder or os.path.exists(policy)
    return Path(policy) if is_path and policy not in shipped_policies() else shipped_policy(policy)


def robot_for(policy: Path, robot: RobotChoice) -> str:
    """The robot that was asked for, or else the one that the policy's contract names.

    Raises:
        PolicyFileError: the file is no policy.
        SprintlabError: the contract names a robot that is not known here.
    """
    return robot_of(load_policy(policy), policy.name) if robot is None else robot_word(robot)


def trial_pool(policy: Path, robot: RobotChoice, workers: int | None) -> TrialPool:
    """Processes for trials of a policy on the robot that was asked for, or else on its contract's.

    Raises:
        SprintlabError: the policy, the robot or the number of processes is refused.
    """
    from sprintlab.evaluation.pool import TrialPool
    from sprintlab.robots import load_robot

    return TrialPool(policy, load_robot(robot_for(policy, robot)), workers)


def robot_word(robot: str | Path) -> str:
    """A robot's name, folder or table as text that means the same."""
    return str(robot.absolute()) if isinstance(robot, Path) else robot


def default_robot() -> str:
    """The robot where neither a robot nor a policy is named: that of the package's standard policy.

    Raises:
        PolicyFileError: the standard policy cannot be read.
    """
    from sprintlab.control import shipped_policy

    return robot_for(shipped_policy(), None)


def robot_of(policy: Policy, name: str) -> str:
    """The robot that the contract of a policy names; ``name`` is the policy's, for the message.

    Raises:
        SprintlabError: that robot is not known here.
    """
    return known_robot(policy.contract.robot_name, name)


def known_robot(robot: str, name: str) -> str:
    """A robot that a file names; ``name`` is the file's. No file decides which folder is looked into.

    Raises:
        SprintlabError: that robot is not known here.
    """
    from sprintlab.robots import robot_names

    if robot not in robot_names():
        raise SprintlabError(
            f"{name} is for robot {robot!r}, unknown here: name its folder or table with --robot"
        )
    return robot


def named_policies(names: tuple[str, ...]) -> dict[str, Any]:
    """Policies by path or name; a number is added to a name that comes twice.

    Raises:
        PolicyFileError: there is no such policy.
    """
    loaded: dict[str, Any] = {}
    for name in names:
        path = policy_path(name)
        label = path.stem if path.stem not in loaded else f"{path.stem} ({len(loaded) + 1})"
        loaded[label] = load_policy(path)
    return loaded


def shipped_policies_opened() -> dict[str, Any]:
    """The policies that come with the package by name, ``sprint`` first."""
    from sprintlab.control.policy import SHIPPED_POLICIES

    paths = sorted(SHIPPED_POLICIES.glob("*.onnx"), key=lambda path: (path.stem != "sprint", path.stem))
    return {path.stem: load_policy(path) for path in paths}


def fitting_policies(policies: dict[str, Any], robot: Any) -> dict[str, Any]:
    """Those of the policies that were made for this robot.

    Raises:
        SprintlabError: none of them fits the robot.
    """
    from sprintlab.control import check_contract

    fitting: dict[str, Any] = {}
    for name, policy in policies.items():
        try:
            check_contract(policy.contract, robot)
        except ContractMismatchError:
            continue
        fitting[name] = policy
    if not fitting:
        raise SprintlabError(f"no policy for robot {robot.name} comes with the package; name a policy file")
    return fitting


@dataclass(frozen=True, kw_only=True)
class ShippedPolicy:
    """A policy that comes with the package."""

    name: str
    """By which every function and command knows it."""
    robot: str
    """The robot it was made for."""
    method: str
    """The training method."""
    path: Path
    """The ONNX file with its contract."""


class ShippedPolicies(Printed, tuple[ShippedPolicy, ...]):
    """The policies that come with the package; a tuple that prints as a table."""

    def tables(self) -> Iterator[RenderableType]:
        """One row per policy."""
        rows = ((item.name, item.robot, item.method) for item in self)
        yield plain_table("Policies", "name", "robot", "method", rows=rows)

    def to_dict(self) -> dict[str, dict[str, str]]:
        """Robot, method and path by name."""
        return {
            item.name: {"robot": item.robot, "method": item.method, "path": str(item.path)} for item in self
        }


def policies() -> ShippedPolicies:
    """The policies that come with the package, with what their contracts say."""
    from sprintlab.control import shipped_policies

    found = []
    for name, path in shipped_policies().items():
        contract = load_policy(path).contract
        found.append(
            ShippedPolicy(name=name, robot=contract.robot_name, method=contract.training.method, path=path)
        )
    return ShippedPolicies(found)


@checked
def load_policy(policy: PolicyChoice) -> Policy:
    """A policy by the path of its file, or by the name of one that comes with the package.

    Raises:
        PolicyFileError: there is no such policy, or the file is not a policy.
        ContractMismatchError: it sees or estimates what this version does not build.
    """
    from sprintlab.control import load_policy as read

    return read(policy_path(policy))

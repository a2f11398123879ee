"""Policies and the robots they drive, by name or by file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from sprintlab.core.errors import ContractMismatchError, SprintlabError

if TYPE_CHECKING:
    from sprintlab.control import Policy


def policy_path(policy: str) -> Path:
    """A policy file by path, or one that comes with the package by name.

    Raises:
        PolicyFileError: there is no such policy.
    """
    from sprintlab.control import shipped_policy

    has_folder = "\\" in policy or ("/" in policy and not policy.startswith("methods/"))
    is_path = policy.endswith(".onnx") or has_folder or Path(policy).exists()
    return Path(policy) if is_path else shipped_policy(policy)


def robot_for(policy: Path, robot: str | None) -> str:
    """The robot that was asked for, or else the one that the policy's contract names.

    Raises:
        PolicyFileError: the file is no policy.
        SprintlabError: the contract names a robot that is not known here.
    """
    from sprintlab.control import load_policy

    return robot_of(load_policy(policy), policy.name) if robot is None else robot


def robot_of(policy: Policy, name: str) -> str:
    """The robot that the contract of a policy names; ``name`` is the policy's, for the message.

    Raises:
        SprintlabError: that robot is not known here.
    """
    from sprintlab.robots import robot_names

    robot = policy.contract.robot_name
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
    from sprintlab.control import load_policy

    loaded: dict[str, Any] = {}
    for name in names:
        path = policy_path(name)
        label = path.stem if path.stem not in loaded else f"{path.stem} ({len(loaded) + 1})"
        loaded[label] = load_policy(path)
    return loaded


def fitting_policies(robot: Any) -> dict[str, Any]:
    """The policies that come with the package and were made for this robot; ``sprint`` first.

    Raises:
        SprintlabError: there is none.
    """
    from sprintlab.control import check_contract, load_policy
    from sprintlab.control.policy import SHIPPED_POLICIES

    fitting: dict[str, Any] = {}
    for path in sorted(SHIPPED_POLICIES.glob("*.onnx"), key=lambda path: (path.stem != "sprint", path.stem)):
        policy = load_policy(path)
        try:
            check_contract(policy.contract, robot)
        except ContractMismatchError:
            continue
        fitting[path.stem] = policy
    if not fitting:
        raise SprintlabError(f"no policy for robot {robot.name} comes with the package; name a policy file")
    return fitting

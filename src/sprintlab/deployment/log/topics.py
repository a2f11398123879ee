"""What stands in a log file."""

from __future__ import annotations

from typing import Any

import msgspec

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.messages import FloatArray, JointCommand, PositionFix, RobotState

CONTRACT_NAME = "contract.json"
FACTS_NAME, END_NAME = "sprintlab", "sprintlab_end"
"""Metadata: the facts of the run, and the number of ticks that were dropped."""


class LogError(SprintlabError):
    """A log cannot be written or read."""


class LogFacts(msgspec.Struct, frozen=True, kw_only=True):
    """What a log says of its run."""

    robot: str  # name of the robot
    contract: str  # the policy's contract, JSON
    facts: dict[str, str] = {}  # anything else worth keeping: command line, date, policy file, bus


class TickRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The rest of a ``ControlTick``, beside the messages of the bus; its fields are described there."""

    time: float
    mode: str
    velocity: FloatArray
    targets: FloatArray
    policy_step: bool
    faults: tuple[str, ...]
    compute_time: float


TOPICS: dict[str, Any] = {
    "/robot/state": RobotState,
    "/robot/command": JointCommand,
    "/robot/fix": PositionFix,
    "/controller/tick": TickRecord,
}
"""Topics of a log and the types of their messages, which the file holds as JSON."""

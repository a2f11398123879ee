"""What stands in a log file."""

from __future__ import annotations

from typing import Any

import msgspec
from msgspec.structs import fields

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.messages import ControlTick, JointCommand, PositionFix, RobotState

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


TickRecord: Any = msgspec.defstruct(
    "TickRecord",
    [(item.name, item.type) for item in fields(ControlTick) if item.name not in ("state", "command", "fix")],
)
"""What a ``ControlTick`` has beside the messages of the bus."""

TOPICS: dict[str, Any] = {
    "/robot/state": RobotState,
    "/robot/command": JointCommand,
    "/robot/fix": PositionFix,
    "/controller/tick": TickRecord,
}
"""Topics of a log and the types of their messages, which the file holds as JSON."""

"""A simulated robot, and the two links between it and whoever drives it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields
from typing import Generic, TypeVar

import numpy as np

from sprintlab.core.checks import check_range
from sprintlab.deployment.messages import JointCommand, PositionFix, RobotState
from sprintlab.deployment.simulator.robot import SimulatedRobot, SimulatorOptions
from sprintlab.robots import RobotDescription

Item = TypeVar("Item")


@dataclass(frozen=True, kw_only=True)
class LinkOptions:
    """A link, each way."""

    delay: float = 0.0  # every message takes at least this long [s], 0 to 1
    jitter: float = 0.0  # and up to this much longer, drawn evenly for each message [s], 0 to 1
    loss: float = 0.0  # share of messages that never arrive, 0 to 1

    def __post_init__(self) -> None:
        for item in fields(self):
            check_range(f"link.{item.name}", getattr(self, item.name), 0.0, 1.0)


class Link(Generic[Item]):
    """Messages under way in one direction. They never overtake each other, as in TCP or a serial line."""

    def __init__(self, options: LinkOptions, seed: int) -> None:
        self._options = options
        self._random = np.random.default_rng(seed)
        self._under_way: deque[tuple[float, Item]] = deque()
        self._latest = 0.0

    def push(self, time: float, item: Item) -> None:
        """Hand a message to the link at ``time`` [s]."""
        lost, late = self._random.random(2)
        if lost < self._options.loss:
            return
        arrival = time + self._options.delay + late * self._options.jitter
        self._latest = max(self._latest, arrival)
        self._under_way.append((self._latest, item))

    def pop(self, time: float) -> list[Item]:
        """Everything that has arrived by ``time`` [s], in order."""
        arrived = []
        # Times are sums of steps: half a microsecond of rounding must not cost a whole step.
        while self._under_way and self._under_way[0][0] <= time + 5e-7:
            arrived.append(self._under_way.popleft()[1])
        return arrived


class SimulatedWorld:
    """Robot and links in simulated time. It knows no bus: messages go in and come out."""

    def __init__(
        self, robot: RobotDescription, options: SimulatorOptions, link: LinkOptions = LinkOptions()
    ) -> None:
        self.robot = SimulatedRobot(robot, options)
        self._states: Link[RobotState | PositionFix] = Link(link, options.seed + 1)
        self._commands: Link[JointCommand] = Link(link, options.seed + 2)

    @property
    def time(self) -> float:
        """Simulated time since the start [s]."""
        return self.robot.time

    def hand_over(self, command: JointCommand) -> None:
        """Give a command to the link, as a controller does."""
        self._commands.push(self.time, command)

    def step(self) -> None:
        """Let the commands that have arrived act, and live for one motor step."""
        for command in self._commands.pop(self.time):
            self.robot.accept(command)
        self.robot.step()

    def messages(self, timestamp: int) -> list[RobotState | PositionFix]:
        """Measure, and return what arrives at the controller now; ``timestamp`` in nanoseconds."""
        fix = self.robot.fix(timestamp)
        if fix is not None:
            self._states.push(self.time, fix)
        self._states.push(self.time, self.robot.state(timestamp))
        return self._states.pop(self.time)

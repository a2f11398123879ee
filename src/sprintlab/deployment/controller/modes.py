"""The modes of the controller, one class each, and the ways between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from typing import ClassVar

import numpy as np

from sprintlab.deployment.controller import motion as motions
from sprintlab.deployment.controller.motion import Motion
from sprintlab.deployment.guard import Fault, Persistence
from sprintlab.deployment.messages import FloatArray, RobotState
from sprintlab.deployment.operators.base import Request
from sprintlab.robots import RobotDescription

REST_SPEED = 2.0
"""Joint speed up to which a joint counts as at rest [rad/s]."""
_REST_TIME = 0.2  # s of rest before the drives of a stopped robot are switched off
_DAMP_TIME = 1.0  # s of damping after sinking
_STAND_ERROR = 0.35  # rad: a stand-up that misses by more has failed
_BRAKED_TIME = 0.6  # s at zero command before the policy hands over
_BRAKED_SPEED = 6.0  # rad/s: joints of a robot that stands
_STANDING_SPEED = 0.5  # m/s: estimated of a robot that steps on the spot
BRAKE_RESERVE = 3.0
"""On top of the time that the commanded speed needs to reach zero [s]: then a brake has failed."""
_CALM_SPEED = 1.0  # rad/s: joints of a robot that has come to rest under the policy
_CALM_TIME = 0.5  # s
_CALM_PATIENCE = 3.0  # s after which a robot lies down whether it has come to rest or not


class Mode(str, Enum):
    """What the controller does: the class of the same name says how."""

    PASSIVE = "passive"
    STAND_UP = "stand-up"
    STAND = "stand"
    RUN = "run"
    LIE_DOWN = "lie-down"
    STOP = "stop"


ACTIVE_MODES = frozenset({Mode.STAND_UP, Mode.STAND, Mode.RUN, Mode.LIE_DOWN})
"""Modes in which the joints are driven; here a lost robot is a fault."""


class Behaviour:
    """What the controller does in one mode, from entering it to leaving it; this one: drives off."""

    mode: ClassVar[Mode] = Mode.PASSIVE
    # the mode to which a request leads; every other is ignored, but ``STOP``, which every active mode obeys
    ways: ClassVar[Mapping[Request, Mode]] = {Request.STAND: Mode.STAND_UP}
    carried: ClassVar[bool] = False  # whether the legs carry the trunk: then a collapse is a fault
    policy_drives: bool = False  # whether the policy gives the targets
    brakes: bool = False  # whether the commanded velocity is brought to zero
    held: bool = False  # whether a fault keeps the robot from running
    motion: Motion | None = None  # the targets where the policy does not drive
    damps: bool = False  # whether joints are damped instead of driven

    def may_leave(self, goal: Mode, time: float) -> bool:
        """Whether the mode has come so far that ``goal`` may follow at ``time`` [s]."""
        return True

    def advance(self, state: RobotState, time: float, velocity: FloatArray) -> Mode | Fault | None:
        """The mode that follows at ``time`` [s], or the fault that ends this one; None: it goes on."""
        return None


class StandUp(Behaviour):
    """Tuck the legs, then rise."""

    mode = Mode.STAND_UP
    ways: ClassVar = {Request.LIE_DOWN: Mode.LIE_DOWN}

    def __init__(self, robot: RobotDescription, here: FloatArray, time: float) -> None:
        self._pose = robot.default_pose
        self.motion: Motion = motions.rise_motion(robot, here, time)

    def advance(self, state: RobotState, time: float, velocity: FloatArray) -> Mode | Fault | None:
        """Stand, once risen; a fault where the robot is not in its standing pose then."""
        if time < self.motion.end_time:
            return None
        error = float(np.abs(state.joint_position - self._pose).max())
        return Mode.STAND if error <= _STAND_ERROR else Fault.STAND_FAILED


class Stand(Behaviour):
    """Hold the standing pose, or, after a run, keep the balance under the policy."""

    mode = Mode.STAND
    ways: ClassVar = {Request.RUN: Mode.RUN, Request.LIE_DOWN: Mode.LIE_DOWN}
    carried = True
    brakes = True

    def __init__(self, robot: RobotDescription, here: FloatArray, time: float, before: Behaviour) -> None:
        self.policy_drives, self.held = before.mode is Mode.RUN, before.held
        self.motion: Motion = motions.settle_motion(robot, here, time)
        self._calm, self._calmed = Persistence(_CALM_TIME), False

    def may_leave(self, goal: Mode, time: float) -> bool:
        """Once settled: to run unless held, to lie down once calm or after some patience."""
        if time < self.motion.end_time:
            return False
        if goal is Mode.LIE_DOWN and self.policy_drives:
            return self._calmed or time - self.motion.end_time > _CALM_PATIENCE
        return goal is not Mode.RUN or not self.held

    def advance(self, state: RobotState, time: float, velocity: FloatArray) -> Mode | Fault | None:
        """Watch the robot come to rest."""
        self._calmed = self._calm.update(fastest_joint(state) < _CALM_SPEED, time)
        return None


class Run(Behaviour):
    """The policy drives.

    ``command_time`` [s] is what the commanded velocity takes to fall from its greatest value to zero,
    ``planar_speed`` the trunk's estimated speed [m/s], None without an estimator.
    """

    mode = Mode.RUN
    ways: ClassVar = {Request.STAND: Mode.STAND, Request.LIE_DOWN: Mode.LIE_DOWN}  # by way of a brake
    carried = True
    policy_drives = True

    def __init__(self, command_time: float, planar_speed: Callable[[], float | None]) -> None:
        self._command_time, self._planar_speed = command_time, planar_speed
        self._brake_started = 0.0
        self._slow = Persistence(_BRAKED_TIME)

    def brake(self, time: float) -> None:
        """Bring the run to a stand."""
        if not self.brakes:
            self.brakes, self._brake_started = True, time

    def advance(self, state: RobotState, time: float, velocity: FloatArray) -> Mode | Fault | None:
        """Stand once the command is zero and the robot at rest, though it may trot on the spot."""
        if not self.brakes:
            return None
        speed = self._planar_speed()
        at_rest = fastest_joint(state) < _BRAKED_SPEED or (speed is not None and speed < _STANDING_SPEED)
        if self._slow.update(at_rest and not velocity[:2].any(), time):
            return Mode.STAND
        longest = self._command_time + _BRAKED_TIME + BRAKE_RESERVE
        return Fault.BRAKE_FAILED if time - self._brake_started > longest else None


class LieDown(Behaviour):
    """Sink over the feet, wherever they stand, onto the belly; then damp."""

    mode = Mode.LIE_DOWN

    def __init__(self, robot: RobotDescription, here: FloatArray, time: float) -> None:
        self.motion: Motion = motions.sink_motion(robot, here, time)

    def advance(self, state: RobotState, time: float, velocity: FloatArray) -> Mode | Fault | None:
        """Damp after the motion, then passive."""
        over = time - self.motion.end_time
        self.damps = over >= 0.0
        return Mode.PASSIVE if over >= _DAMP_TIME else None


class Stop(Behaviour):
    """Damp until an operator lets go, and until the joints have been at rest for a while."""

    mode = Mode.STOP
    ways: ClassVar = {Request.PASSIVE: Mode.PASSIVE}
    damps = True

    def __init__(self) -> None:
        self._rest, self._rested = Persistence(_REST_TIME), False

    def may_leave(self, goal: Mode, time: float) -> bool:
        """Once at rest: in a gallop all joints may be slow for a moment."""
        return self._rested

    def advance(self, state: RobotState, time: float, velocity: FloatArray) -> Mode | Fault | None:
        """Watch the joints come to rest."""
        self._rested = self._rest.update(fastest_joint(state) < REST_SPEED, time)
        return None


def fastest_joint(state: RobotState) -> float:
    """Greatest joint speed [rad/s]."""
    return float(np.abs(state.joint_velocity).max())

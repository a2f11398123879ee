"""The controller as a function of time: states in, one joint command out, no clock and no bus of its own.

It steps at 1 kHz. Every 20 ms it reads the command source and, in ``run``, the policy, through
``sprintlab.control.PolicyRuntime``: the very code that the evaluation uses. What it sends has passed
``CommandGuard``. Simulated time and real time are the same to it.
"""

from __future__ import annotations

import math
import time as clock
from collections import Counter, deque
from collections.abc import Sequence

import numpy as np

from sprintlab.commands import heading_command
from sprintlab.control import POLICY_RATE_HZ, Measurement, Policy, PolicyRuntime
from sprintlab.control import projected_gravity as gravity_in_body
from sprintlab.deployment.controller import modes
from sprintlab.deployment.controller.course import Course
from sprintlab.deployment.controller.modes import ACTIVE_MODES, Mode
from sprintlab.deployment.controller.outgoing import CommandWriter
from sprintlab.deployment.guard import BodyMonitor, Fault, Reaction, StateMonitor, VelocityLimiter
from sprintlab.deployment.guard.monitors import trunk_tilt
from sprintlab.deployment.messages import (
    COMMAND_BOUNDS,
    ControlTick,
    FloatArray,
    JointCommand,
    PositionFix,
    RobotState,
    RobotStatus,
)
from sprintlab.deployment.operators.base import CommandSource, OperatorCommand, Request, SourceView
from sprintlab.deployment.transports.address import new_session
from sprintlab.robots import RobotDescription

POLICY_PERIOD_NS = round(1e9 / POLICY_RATE_HZ)

_WARM_UP_STEPS = 20
_LATE_WINDOW, _LATE_STEPS = 50, 10  # policy steps looked at, and late ones among them that are a fault
_LATE = 0.005  # s of delay from which a policy step counts as late
_STALL = 0.040  # s between two steps of the loop that are a fault
_START_TILT = 30.0  # degrees up to which the robot may stand up


class Controller:
    """Runs one policy on one robot, at commanded speeds up to ``top_speed`` [m/s]."""

    def __init__(
        self, policy: Policy, robot: RobotDescription, source: CommandSource, *, top_speed: float = 12.0
    ) -> None:
        self.session = new_session()  # number that its commands carry
        self._robot, self._source = robot, source
        self._runtime = PolicyRuntime(policy, robot)
        self._states, self._body = StateMonitor(robot), BodyMonitor(robot)
        self._commands = CommandWriter(robot, self.session)
        self._limiter = VelocityLimiter(top_speed)
        self._wish = np.zeros(3)  # the last sound one of the source
        self._heard_at = -math.inf  # the source, last
        self._targets: FloatArray = np.array(robot.default_pose)
        self._course = Course()
        self._late: deque[bool] = deque(maxlen=_LATE_WINDOW)
        self._start: int | None = None
        self._now, self._time, self._next_policy = 0, 0.0, 0
        self._answer, self._answered_at = 0, -math.inf
        self._faults: list[Fault] = []
        self._run_started = 0.0
        self._override = Request.NONE
        self._behaviour = modes.Behaviour()
        self.fault_counts: Counter[Fault] = Counter()
        self.stop_reason = ""  # the fault, or ``operator``, that led to the present or last ``stop``
        self.policy_time = 0.0  # duration of the last policy step [s]
        self.moving_since: float | None = None  # when the last run's command was first not zero [s]
        still = Measurement(np.zeros(3), np.array([0.0, 0.0, -1.0]), self._targets, 0.0 * self._targets)
        for _ in range(_WARM_UP_STEPS):  # a network's first steps are slow: later a robot waits
            self._runtime.step(still, self._limiter.velocity)
        self._runtime.reset()

    @property
    def mode(self) -> Mode:
        """What the controller does now."""
        return self._behaviour.mode

    @property
    def state(self) -> RobotState | None:
        """The last accepted state."""
        return self._states.last

    @property
    def commanded_speed(self) -> float:
        """Forward speed that the policy is asked for [m/s]."""
        return float(self._limiter.velocity[0])

    @property
    def braking(self) -> bool:
        """Whether a run is being brought to a stand."""
        return self.mode is Mode.RUN and self._behaviour.brakes

    def come_down(self, *, at_once: bool = False) -> None:
        """Bring the robot down, whatever the source says but a stop: brake, stand, lie; or stop at once."""
        self._override = Request.STOP if at_once else Request.LIE_DOWN

    def last_command(self, now: int) -> JointCommand:
        """What to send before leaving the robot alone at ``now`` [ns]: off if passive, else damping."""
        if self.mode is not Mode.PASSIVE:
            self._enter_stop("the controller ends")
        return self._command(now)

    def step(self, now: int, states: Sequence[RobotState], fix: PositionFix | None = None) -> ControlTick:
        """One step of the 1 kHz loop; the ``command`` of what it returns is to be sent at once.

        Args:
            now: monotonic clock [ns], above that of the step before.
            states: states that arrived since then, in order of arrival.
            fix: a position fix that arrived.
        """
        begin = clock.perf_counter_ns()
        self._faults = []
        self._watch_loop(now)
        for state in states:
            self._take_state(state)
        if fix is not None and not self._course.take(fix, self._time):
            self._note(Fault.FIX_INVALID)
        self._watch_link()
        self._react()
        policy_step = now >= self._next_policy
        if policy_step:
            self._policy_period(now)
            self._react()
        self._advance_mode()
        command = self._command(now)
        return ControlTick(
            time=self._time,
            mode=self.mode.value,
            state=self._states.last,
            command=command,
            velocity=self._limiter.velocity,
            targets=self._targets,
            policy_step=policy_step and self._behaviour.policy_drives,
            fix=fix,
            faults=tuple(fault.value for fault in self._faults),
            compute_time=(clock.perf_counter_ns() - begin) * 1e-9,
        )

    # ---- what comes in -------------------------------------------------------------------------------

    def _note(self, *faults: Fault) -> None:
        self._faults.extend(faults)
        self.fault_counts.update(faults)

    def _watch_loop(self, now: int) -> None:
        if self._start is None:
            self._start = self._now = self._next_policy = now
        if (now - self._now) * 1e-9 >= _STALL and self.mode in ACTIVE_MODES:
            self._note(Fault.LOOP_STALLED)
        self._now, self._time = now, (now - self._start) * 1e-9

    def _take_state(self, state: RobotState) -> None:
        self._commands.answers = state.sequence
        self._note(*self._states.accept(state, self._time))
        if self._states.last is state:
            self._take_answer(state)
            self._note(*self._body.check(state, self._time, carried=self._behaviour.carried))

    def _take_answer(self, state: RobotState) -> None:
        """Which command the robot obeys: one of ours, later than the one before, or another controller's."""
        if not self._commands.has_sent(state) or state.command_sequence < self._answer:
            if self.mode in ACTIVE_MODES:
                self._note(Fault.COMMANDS_FOREIGN)
        elif state.command_sequence > self._answer:
            self._answer, self._answered_at = state.command_sequence, self._time

    def _watch_link(self) -> None:
        if self.mode not in ACTIVE_MODES:
            if self.mode is Mode.PASSIVE and self._states.stale(self._time):
                self._forget_robot()
            return
        if self._states.stale(self._time):
            self._note(Fault.STATE_STALE)
        elif not self._is_answered:
            self._note(Fault.COMMANDS_UNANSWERED)
        if self._states.last is not None and self._states.last.status & RobotStatus.WATCHDOG_EXPIRED:
            self._note(Fault.WATCHDOG_EXPIRED)

    @property
    def _is_answered(self) -> bool:
        return self._time - self._answered_at < Fault.COMMANDS_UNANSWERED.lasts - 1e-9

    @property
    def _source_lost(self) -> bool:
        return self._time - self._heard_at >= Fault.SOURCE_LOST.lasts - 1e-9

    def _forget_robot(self) -> None:
        """Whatever comes next may be a robot that was restarted."""
        self._states.reset()
        self._body.reset()
        self._course.forget_fix()
        self._answer = 0

    # ---- reactions -----------------------------------------------------------------------------------

    def _react(self) -> None:
        """Follow the gravest reaction to the faults of this step."""
        reactions = {fault.reaction: fault for fault in reversed(self._faults)}
        if Reaction.STOP in reactions and self.mode in ACTIVE_MODES:
            self._enter_stop(reactions[Reaction.STOP].value)
        elif Reaction.BRAKE in reactions and isinstance(self._behaviour, modes.Run):
            self._behaviour.held = True
            self._behaviour.brake(self._time)

    def _enter_stop(self, reason: str) -> None:
        if self.mode is not Mode.STOP:
            self._behaviour = modes.Stop()
        self.stop_reason = reason
        self._limiter.reset()

    # ---- 50 Hz ---------------------------------------------------------------------------------------

    def _policy_period(self, now: int) -> None:
        behind = now - self._next_policy
        self._next_policy = (self._next_policy if behind < POLICY_PERIOD_NS else now) + POLICY_PERIOD_NS
        state = self._states.last
        if state is None:
            return
        self._late.append(behind * 1e-9 > _LATE)
        if self.mode is Mode.RUN and sum(self._late) >= _LATE_STEPS and not self.braking:
            self._note(Fault.POLICY_LATE)
        request = self._read_source(state)
        self._obey(request if request == Request.STOP else self._override or request, state)
        if self._behaviour.policy_drives:
            self._run_policy(state)

    def _read_source(self, state: RobotState) -> Request:
        """Take what the source says: its velocity, if that is sound; returns what it asks for."""
        try:
            command = self._source.read(self._view(state))
        except Exception:  # whatever breaks in a device must not break the loop
            command = OperatorCommand(np.full(3, np.nan))
        if command is None:
            return Request.NONE
        if command.velocity.shape != (3,) or not np.isfinite(command.velocity).all():
            self._note(Fault.SOURCE_INVALID)
            return Request.NONE
        self._wish, self._heard_at = command.velocity, self._time
        return command.request

    def _view(self, state: RobotState) -> SourceView:
        return SourceView(
            time=self._time,
            mode=self.mode.value,
            running_time=self._time - self._run_started,
            heading=self._course.heading(state),
            track=self._course.point(self._time),
        )

    def _obey(self, request: Request, state: RobotState) -> None:
        if request == Request.STOP and self.mode in ACTIVE_MODES:
            self._enter_stop("operator")
        behaviour = self._behaviour
        if request == Request.STAND and isinstance(behaviour, modes.Stand):
            behaviour.held = False
        goal = behaviour.ways.get(request)
        if goal is None:
            return
        if isinstance(behaviour, modes.Run):
            behaviour.brake(self._time)
        elif self._may_leave(goal, state):
            self._enter(goal, state)

    def _may_leave(self, goal: Mode, state: RobotState) -> bool:
        """Whether the robot is fit for ``goal``; an unfit robot stays where it is."""
        if self.mode is Mode.PASSIVE:
            answered = self._commands.has_sent(state) and self._is_answered
            at_rest = modes.fastest_joint(state) < modes.REST_SPEED
            upright = trunk_tilt(state) < _START_TILT
            return answered and upright and at_rest and state.status == RobotStatus.READY
        if self.mode is Mode.STOP and self._states.stale(self._time):
            return True
        if goal is Mode.RUN and self._source_lost:
            return False
        return self._behaviour.may_leave(goal, self._time)

    def _run_policy(self, state: RobotState) -> None:
        dt = POLICY_PERIOD_NS * 1e-9
        if self.mode is Mode.RUN and self._source_lost and not self.braking:
            self._note(Fault.SOURCE_LOST)
            self._react()
        if self._behaviour.brakes:
            point = self._course.point(self._time)
            offset = 0.0 if point is None else point.offset
            yaw_rate = float(heading_command(self._course.heading(state), offset, self.commanded_speed))
            velocity = self._limiter.brake(dt, yaw_rate)
        else:
            velocity = self._limiter.advance(self._wish, dt)
        if self.moving_since is None and velocity[0] != 0.0:
            self.moving_since = self._time - self._run_started
        begin = clock.perf_counter_ns()
        try:
            targets = np.asarray(self._runtime.step(_measurement(state), velocity), dtype=np.float64)
        except Exception:  # whatever breaks in a policy must end in a stop, not in a dead loop
            targets = np.full(1, np.nan)
        self.policy_time = (clock.perf_counter_ns() - begin) * 1e-9
        least, greatest = COMMAND_BOUNDS["target_position"]
        if targets.shape == self._targets.shape and ((least <= targets) & (targets <= greatest)).all():
            self._targets = targets
        else:
            self._note(Fault.POLICY_INVALID)

    # ---- modes ---------------------------------------------------------------------------------------

    def _enter(self, mode: Mode, state: RobotState) -> None:
        before, robot, here = self._behaviour, self._robot, self._commands.bumpless_start
        if mode is Mode.STAND_UP:
            self._behaviour = modes.StandUp(robot, here(state), self._time)
        elif mode is Mode.STAND:
            self._behaviour = modes.Stand(robot, here(state), self._time, before)
        elif mode is Mode.LIE_DOWN:
            self._limiter.reset()
            self._behaviour = modes.LieDown(robot, here(state), self._time)
        elif mode is Mode.RUN:
            self._behaviour = modes.Run(self._limiter.braking_time, self._estimated_speed)
            self._runtime.reset()
            self._limiter.reset()
            self._late.clear()
            self._course.start(state)
            self._run_started, self.moving_since = self._time, None
        else:
            self._behaviour = modes.Behaviour()
            if before.mode is Mode.STOP:
                self._forget_robot()

    def _estimated_speed(self) -> float | None:
        """Speed of the trunk along the ground, as the policy estimates it [m/s]."""
        estimate = self._runtime.last_estimate
        return None if estimate is None else float(np.hypot(estimate[0], estimate[1]))

    def _advance_mode(self) -> None:
        """Leave a mode that has done its work, and move the targets of those without a policy."""
        state = self._states.last
        if state is None:
            return
        outcome = self._behaviour.advance(state, self._time, self._limiter.velocity)
        if isinstance(outcome, Mode):
            self._enter(outcome, state)
        elif outcome is not None:
            self._note(outcome)
            self._react()
        behaviour = self._behaviour
        if behaviour.motion is not None and not behaviour.policy_drives:
            self._targets = behaviour.motion.target(self._time)

    def _command(self, now: int) -> JointCommand:
        state = self._states.last
        if self.mode is Mode.PASSIVE or state is None:
            return self._commands.off(now)
        if self._behaviour.damps:
            return self._commands.damping(now, state, stale=self._states.stale(self._time))
        return self._commands.servo(now, state, self._targets)


def _measurement(state: RobotState) -> Measurement:
    return Measurement(
        angular_velocity=state.angular_velocity,
        projected_gravity=np.asarray(gravity_in_body(state.quaternion)),
        joint_position=state.joint_position,
        joint_velocity=state.joint_velocity,
    )

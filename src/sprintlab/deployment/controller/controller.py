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

from sprintlab.commands import heading_angle, heading_command
from sprintlab.control import POLICY_RATE_HZ, Measurement, Policy, PolicyRuntime
from sprintlab.control import projected_gravity as gravity_in_body
from sprintlab.deployment.controller.course import Course, LastFix
from sprintlab.deployment.controller.modes import ACTIVE_MODES, REQUESTED, Mode
from sprintlab.deployment.controller.motion import (
    JointMotion,
    Motion,
    SinkMotion,
    Waypoint,
    feet_apart,
    gather_motion,
    rise_motion,
)
from sprintlab.deployment.controller.outgoing import CommandWriter
from sprintlab.deployment.interface import (
    CommandSource,
    ControlTick,
    FloatArray,
    JointCommand,
    OperatorCommand,
    PositionFix,
    Request,
    RobotState,
    RobotStatus,
    SourceView,
    new_session,
)
from sprintlab.deployment.safety import (
    RESPONSES,
    BodyMonitor,
    Fault,
    Reaction,
    SafetySettings,
    SourceMonitor,
    StateMonitor,
    VelocityLimiter,
    VelocityLimits,
    trunk_tilt,
)
from sprintlab.deployment.safety.timer import Persistence
from sprintlab.robots import RobotDescription

POLICY_PERIOD_NS = round(1e9 / POLICY_RATE_HZ)

_TUCK_TIME = 1.0  # s
_RISE_TIME = 1.5  # s
_SINK_TIME = 1.5  # s
_DAMP_TIME = 1.0  # s of damping after sinking
_SETTLE_TIME = 0.4  # s from the policy's pose to the standing pose
_STAND_ERROR = 0.35  # rad: a stand-up that misses by more has failed
_BRAKED_TIME = 0.6  # s at zero command before the policy hands over
_BRAKED_SPEED = 6.0  # rad/s: joints of a robot that stands or steps on the spot
_BRAKE_RESERVE = 3.0  # s on top of the time the command needs to reach zero
_CALM_SPEED = 1.0  # rad/s: joints of a robot that has come to rest under the policy
_CALM_TIME = 0.5  # s
_CALM_PATIENCE = 3.0  # s after which a robot lies down whether it has come to rest or not
_GATHERS = 3  # times at most that the feet are stepped under the robot
_GATHERED = 0.15  # of the standing height: feet nearer than this to their places may stay
_WARM_UP_STEPS = 20
_LATE_WINDOW = 50  # policy steps


class Controller:
    """Runs one policy on one robot.

    Args:
        policy: the loaded policy.
        robot: the robot it drives.
        source: where the commanded velocity comes from.
        safety: thresholds.
        limits: bounds of the commanded velocity.
        session: that its commands carry; drawn at random when left out.

    Attributes:
        session: that its commands carry.
        mode: what it does now.
        fault_counts: how often each fault was noticed.
        stop_reason: the fault, or ``operator``, that led to the present or last ``stop``.
        policy_time: duration of the last policy step [s].
        moving_since: time in the last run at which the command was first not zero [s]; None before.

    Raises:
        ContractMismatchError: the policy was not made for this robot.
    """

    def __init__(
        self,
        policy: Policy,
        robot: RobotDescription,
        source: CommandSource,
        *,
        safety: SafetySettings | None = None,
        limits: VelocityLimits | None = None,
        session: int | None = None,
    ) -> None:
        self.session = new_session() if session is None else session
        self._robot, self._source = robot, source
        self._safety = safety or SafetySettings()
        self._runtime = PolicyRuntime(policy, robot)
        self._states = StateMonitor(robot, self._safety)
        self._body = BodyMonitor(robot, self._safety)
        self._commands = CommandWriter(robot, self.session)
        self._operator = SourceMonitor(self._safety.source_timeout)
        self._limiter = VelocityLimiter(limits or VelocityLimits())
        self._velocity = np.zeros(3)
        self._targets: FloatArray = np.array(robot.default_pose)
        self._motion: Motion = JointMotion(self._targets, 0.0)
        self._course = Course(0.0)
        self._late: deque[bool] = deque(maxlen=_LATE_WINDOW)
        self._slow = Persistence(_BRAKED_TIME)
        self._calm = Persistence(_CALM_TIME)
        self._calmed = False
        self._rest = Persistence(self._safety.rest_time)
        self._rested = False
        self._gathers_left = 0
        self._gathering = False
        self._start: int | None = None
        self._now = self._next_policy = 0
        self._answer, self._answered_at = 0, -math.inf
        self._fix = LastFix(self._safety.fix_timeout)
        self._faults: list[Fault] = []
        self._run_started = 0.0
        self._brake_started: float | None = None
        self._held = False
        self._balancing = False
        self._override: Request | None = None
        self.mode = Mode.PASSIVE
        self.fault_counts: Counter[Fault] = Counter()
        self.stop_reason = ""
        self.policy_time = 0.0
        self.moving_since: float | None = None
        self._warm_up()

    @property
    def state(self) -> RobotState | None:
        """The last accepted state."""
        return self._states.last

    @property
    def robot_obeys_another(self) -> bool:
        """Whether the robot's last state says that it obeys another controller."""
        return self._states.last is not None and self._states.last.session not in (0, self.session)

    @property
    def commanded_speed(self) -> float:
        """Forward speed that the policy is asked for [m/s]."""
        return float(self._velocity[0])

    @property
    def braking(self) -> bool:
        """Whether a run is being brought to a stand."""
        return self._brake_started is not None

    def come_down(self, *, at_once: bool = False) -> None:
        """Bring the robot down whatever the source says: brake, stand, lie down; or stop at once."""
        self._override = Request.STOP if at_once else Request.LIE_DOWN

    def last_command(self, now: int) -> JointCommand:
        """What to send before leaving the robot alone at ``now`` [ns]: off if passive, else damping."""
        if self.mode is not Mode.PASSIVE:
            self._enter_stop("the controller ends")
        return self._command(now)

    def step(self, now: int, states: Sequence[RobotState], fix: PositionFix | None = None) -> ControlTick:
        """One step of the 1 kHz loop.

        Args:
            now: monotonic clock [ns], above that of the step before.
            states: what arrived since then, in order of arrival.
            fix: a position fix that arrived.

        Returns:
            What happened; its ``command`` is to be sent at once.
        """
        begin = clock.perf_counter_ns()
        self._faults = []
        self._watch_loop(now)
        time = self._time
        for state in states:
            self._take_state(state, time)
        self._take_fix(fix, time)
        self._watch_link(time)
        self._react(time)
        policy_step = now >= self._next_policy
        if policy_step:
            self._policy_period(now, time)
            self._react(time)
        self._advance_mode(time)
        command = self._command(now)
        return ControlTick(
            time=time,
            mode=self.mode.value,
            state=self._states.last,
            command=command,
            velocity=self._velocity,
            targets=self._targets,
            policy_step=policy_step and self._policy_drives,
            fix=fix,
            faults=tuple(fault.value for fault in self._faults),
            compute_time=(clock.perf_counter_ns() - begin) * 1e-9,
        )

    def _warm_up(self) -> None:
        """Go every way now that is slow the first time: later a robot waits."""
        still, guard = _standing_state(self._robot), self._commands.guard
        for _ in range(_WARM_UP_STEPS):
            self._runtime.step(_measurement(still), self._velocity)
            for age in (0.0, 1e-3):
                guard.servo(self._targets, self._robot.stiffness, self._robot.damping, still, age)
            guard.damping(self._robot.damping, still)
            self._body.check(still, 0.0, carried=True)
            self._states.accept(still, 0.0)
            self._limiter.advance(self._velocity, 0.0)
            self._view(still, 0.0)
            heading_command(0.0, 0.0, 0.0)
        self._runtime.reset()
        self._forget_robot()

    # ---- what comes in -------------------------------------------------------------------------------

    def _note(self, *faults: Fault) -> None:
        self._faults.extend(faults)
        self.fault_counts.update(faults)

    def _watch_loop(self, now: int) -> None:
        if self._start is None:
            self._start = self._now = self._next_policy = now
        stalled = (now - self._now) * 1e-9 >= self._safety.stall_time
        self._now = now
        if stalled and self.mode in ACTIVE_MODES:
            self._note(Fault.LOOP_STALLED)

    def _take_state(self, state: RobotState, time: float) -> None:
        faults = self._states.accept(state, time)
        self._note(*faults)
        if self._states.last is not state:
            return
        self._take_answer(state, time)
        carried = self.mode in (Mode.STAND, Mode.RUN)
        self._note(*self._body.check(state, time, carried=carried))

    def _take_answer(self, state: RobotState, time: float) -> None:
        """Which command the robot obeys: one of ours, later than the one before, or somebody else's."""
        if not self._obeyed_by(state) or state.command_sequence < self._answer:
            if self.mode in ACTIVE_MODES:
                self._note(Fault.COMMANDS_FOREIGN)
        elif state.command_sequence > self._answer:
            self._answer, self._answered_at = state.command_sequence, time

    def _obeyed_by(self, state: RobotState) -> bool:
        return self._commands.has_sent(state)

    def _take_fix(self, fix: PositionFix | None, time: float) -> None:
        if fix is not None and not self._fix.take(fix, time):
            self._note(Fault.FIX_INVALID)

    def _watch_link(self, time: float) -> None:
        if self.mode not in ACTIVE_MODES:
            if self.mode is Mode.PASSIVE and self._states.stale(time):
                self._forget_robot()
            return
        if self._states.stale(time):
            self._note(Fault.STATE_STALE)
        elif time - self._answered_at >= self._safety.answer_timeout - 1e-9:
            self._note(Fault.COMMANDS_UNANSWERED)
        if self._states.last is not None and self._states.last.status & RobotStatus.WATCHDOG_EXPIRED:
            self._note(Fault.WATCHDOG_EXPIRED)

    def _forget_robot(self) -> None:
        """Whatever comes next may be a robot that was restarted."""
        self._states.reset()
        self._body.reset()
        self._fix.forget()
        self._answer = 0

    # ---- reactions -----------------------------------------------------------------------------------

    def _react(self, time: float) -> None:
        """Follow the gravest reaction to the faults of this step."""
        reactions = {RESPONSES[fault].reaction for fault in self._faults}
        if Reaction.STOP in reactions and self.mode in ACTIVE_MODES:
            gravest = (f for f in self._faults if RESPONSES[f].reaction is Reaction.STOP)
            self._enter_stop(next(gravest).value)
        elif Reaction.BRAKE in reactions and self.mode is Mode.RUN:
            self._held = True
            self._start_brake(time)

    def _enter_stop(self, reason: str) -> None:
        if self.mode is not Mode.STOP:
            self._rested = False
            self._rest.reset()
        self.mode, self.stop_reason = Mode.STOP, reason
        self._brake_started = None
        self._limiter.reset()
        self._velocity = np.zeros(3)

    def _start_brake(self, time: float) -> None:
        if self._brake_started is None:
            self._brake_started = time
            self._slow.reset()

    # ---- 50 Hz ---------------------------------------------------------------------------------------

    def _policy_period(self, now: int, time: float) -> None:
        late = (now - self._next_policy) * 1e-9 > self._safety.late_step
        in_time = now - self._next_policy < POLICY_PERIOD_NS
        self._next_policy = (self._next_policy if in_time else now) + POLICY_PERIOD_NS
        state = self._states.last
        if state is None:
            return
        self._watch_lateness(late)
        request, faults = self._operator.accept(self._read_source(state, time), time)
        self._note(*faults)
        self._obey(request if self._override is None else self._override, state, time)
        if self._policy_drives:
            self._run_policy(state, time)

    @property
    def _policy_drives(self) -> bool:
        """In a run, and in the stand after it: there the policy keeps the balance."""
        return self.mode is Mode.RUN or (self.mode is Mode.STAND and self._balancing)

    def _watch_lateness(self, late: bool) -> None:
        self._late.append(late)
        if self.mode is Mode.RUN and sum(self._late) >= self._safety.late_steps and not self.braking:
            self._note(Fault.POLICY_LATE)

    def _read_source(self, state: RobotState, time: float) -> OperatorCommand | None:
        try:
            return self._source.read(self._view(state, time))
        except Exception:  # whatever breaks in a device must not break the loop
            self._note(Fault.SOURCE_INVALID)
            return None

    def _view(self, state: RobotState, time: float) -> SourceView:
        fix = self._fix.fresh(time)
        offset, speed = self._course.offset_and_speed(fix)
        return SourceView(
            time=time,
            running_time=time - self._run_started if self.mode is Mode.RUN else None,
            mode=self.mode.value,
            state=state,
            fix=fix,
            heading=self._course.relative_heading(state),
            lateral_offset=offset,
            forward_speed=speed,
        )

    def _obey(self, request: Request, state: RobotState, time: float) -> None:
        if request == Request.STOP and self.mode in ACTIVE_MODES:
            self._enter_stop("operator")
        if request == Request.STAND and self.mode is Mode.STAND:
            self._held = False
        goal = REQUESTED.get((self.mode, request))
        if goal is None:
            return
        if self.mode is Mode.RUN:
            self._start_brake(time)
        elif self._may_leave(goal, state, time):
            self._enter(goal, state, time)

    def _may_leave(self, goal: Mode, state: RobotState, time: float) -> bool:
        """Whether the robot is fit for ``goal``; an unfit robot stays where it is."""
        if self.mode is Mode.PASSIVE:
            return self._ready(state, time)
        if self.mode is Mode.STOP:
            return self._states.stale(time) or self._rested
        if self.mode is Mode.STAND and time < self._motion.end_time:
            return False
        if goal is Mode.LIE_DOWN and self._policy_drives:
            return self._calmed or time - self._motion.end_time > _CALM_PATIENCE
        return goal is not Mode.RUN or not (self._held or self._operator.lost(time))

    def _ready(self, state: RobotState, time: float) -> bool:
        answered = self._obeyed_by(state) and time - self._answered_at < self._safety.answer_timeout
        upright = trunk_tilt(state) < self._safety.start_tilt
        return answered and upright and state.status == RobotStatus.READY and self._at_rest(state)

    def _at_rest(self, state: RobotState) -> bool:
        return float(np.abs(state.joint_velocity).max()) < self._safety.start_speed

    def _run_policy(self, state: RobotState, time: float) -> None:
        dt = POLICY_PERIOD_NS * 1e-9
        if self.mode is Mode.RUN and self._operator.lost(time) and not self.braking:
            self._note(Fault.SOURCE_LOST)
            self._react(time)
        if self.braking or self.mode is Mode.STAND:
            offset, _ = self._course.offset_and_speed(self._fix.fresh(time))
            heading = self._course.relative_heading(state)
            yaw_rate = float(heading_command(heading, offset, float(self._velocity[0])))
            self._velocity = self._limiter.brake(dt, yaw_rate)
        else:
            self._velocity = self._limiter.advance(self._operator.velocity, dt)
        if self.moving_since is None and self._velocity[0] != 0.0:
            self.moving_since = time - self._run_started
        begin = clock.perf_counter_ns()
        try:
            targets = np.asarray(self._runtime.step(_measurement(state), self._velocity), dtype=np.float64)
        except Exception:  # whatever breaks in a policy must end in a stop, not in a dead loop
            targets = np.empty(0)
        self.policy_time = (clock.perf_counter_ns() - begin) * 1e-9
        if targets.shape == self._targets.shape and np.isfinite(targets).all():
            self._targets = targets
        else:
            self._note(Fault.POLICY_INVALID)

    # ---- modes ---------------------------------------------------------------------------------------

    def _enter(self, mode: Mode, state: RobotState, time: float) -> None:
        ran, self.mode = self.mode is Mode.RUN, mode
        standing = np.array(self._robot.default_pose)
        here = self._commands.bumpless_start(state)
        if mode is Mode.STAND_UP:
            self._held = self._balancing = False
            self._motion = rise_motion(self._robot, here, time, _TUCK_TIME, _RISE_TIME)
        elif mode is Mode.STAND:
            self._brake_started = None
            self._balancing, self._calmed = ran, False
            self._calm.reset()
            self._motion = JointMotion(here, time, Waypoint(standing, _SETTLE_TIME))
        elif mode is Mode.LIE_DOWN:
            self._brake_started = None
            self._velocity = np.zeros(3)
            # Where a run has left the feet, only the policy keeps the balance: step them below the robot.
            self._gathers_left = _GATHERS if self._balancing else 0
            self._motion = self._way_down(state, time)
        elif mode is Mode.RUN:
            self._start_run(state, time)
        else:
            self._forget_robot()

    def _way_down(self, state: RobotState, time: float) -> Motion:
        """The next motion of lying down: gather the feet as long as they stand apart, then sink over them."""
        here = self._commands.bumpless_start(state)
        apart = feet_apart(self._robot, state) > _GATHERED * self._robot.standing_height
        self._gathering = apart and self._gathers_left > 0
        if self._gathering:
            self._gathers_left -= 1
            return gather_motion(self._robot, state, here, time)
        return SinkMotion(self._robot, here, time, _SINK_TIME, _TUCK_TIME)

    def _start_run(self, state: RobotState, time: float) -> None:
        self._runtime.reset()
        self._limiter.reset()
        self._late.clear()
        self._course = Course(float(heading_angle(state.quaternion)))
        self._run_started, self.moving_since = time, None

    def _advance_mode(self, time: float) -> None:
        """Leave a mode that has done its work, and move the targets of those without a policy."""
        state = self._states.last
        if state is None:
            return
        if self.mode is Mode.RUN:
            self._end_brake(state, time)
        elif self.mode is Mode.STAND_UP and time >= self._motion.end_time:
            self._end_stand_up(state, time)
        elif self.mode is Mode.STAND and self._balancing:
            speed = float(np.abs(state.joint_velocity).max())
            self._calmed = self._calm.update(speed < _CALM_SPEED, time)
        elif self.mode is Mode.LIE_DOWN:
            self._lie_down(state, time)
        elif self.mode is Mode.STOP:
            self._rested = self._rest.update(self._at_rest(state), time)
        if self.mode in (Mode.STAND_UP, Mode.STAND, Mode.LIE_DOWN) and not self._policy_drives:
            self._targets = self._motion.target(time)

    def _lie_down(self, state: RobotState, time: float) -> None:
        if self._gathering and time >= self._motion.end_time:
            self._motion = self._way_down(state, time)
        elif not self._gathering and time >= self._motion.end_time + _DAMP_TIME:
            self.mode = Mode.PASSIVE

    def _end_stand_up(self, state: RobotState, time: float) -> None:
        error = float(np.abs(state.joint_position - self._robot.default_pose).max())
        if error <= _STAND_ERROR:
            self._enter(Mode.STAND, state, time)
        else:
            self._note(Fault.STAND_FAILED)
            self._react(time)

    def _end_brake(self, state: RobotState, time: float) -> None:
        """Hand over from the policy once the command is zero and the joints have calmed down."""
        if self._brake_started is None:
            return
        calm = float(np.abs(state.joint_velocity).max()) < _BRAKED_SPEED
        if self._slow.update(calm and not self._velocity[:2].any(), time):
            self._enter(Mode.STAND, state, time)
        elif time - self._brake_started > self._longest_brake:
            self._note(Fault.BRAKE_FAILED)
            self._react(time)

    @property
    def _longest_brake(self) -> float:
        limits = self._limiter.limits
        return limits.forward / limits.braking + _BRAKED_TIME + _BRAKE_RESERVE

    # ---- what goes out -------------------------------------------------------------------------------

    def _command(self, now: int) -> JointCommand:
        state = self._states.last
        if self.mode is Mode.PASSIVE or state is None:
            return self._commands.off(now, state)
        if self.mode is not Mode.STOP and not self._damps_after_sinking():
            command = self._commands.servo(now, state, self._targets)
            if command is not None:
                return command
            self._note(Fault.POLICY_INVALID)
            self._enter_stop(Fault.POLICY_INVALID.value)
        return self._commands.damping(now, state, stale=self._states.stale(self._time))

    @property
    def _time(self) -> float:
        """Of this step, since the controller's start [s]."""
        return (self._now - (self._start or 0)) * 1e-9

    def _damps_after_sinking(self) -> bool:
        return self.mode is Mode.LIE_DOWN and not self._gathering and self._time >= self._motion.end_time


def _standing_state(robot: RobotDescription) -> RobotState:
    """What a robot says that stands still."""
    zeros = np.zeros(len(robot.joint_names))
    return RobotState(
        sequence=0,
        timestamp=0,
        joint_position=np.array(robot.default_pose),
        joint_velocity=zeros,
        joint_torque=zeros,
        quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
        angular_velocity=np.zeros(3),
        bus_voltage=robot.bus_voltage,
    )


def _measurement(state: RobotState) -> Measurement:
    return Measurement(
        angular_velocity=state.angular_velocity,
        projected_gravity=np.asarray(gravity_in_body(state.quaternion)),
        joint_position=state.joint_position,
        joint_velocity=state.joint_velocity,
    )

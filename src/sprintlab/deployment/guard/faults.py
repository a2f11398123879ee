"""Every fault the controller knows, and what it does about each within which time."""

from __future__ import annotations

from enum import Enum


class Reaction(str, Enum):
    """What the controller does about a fault, from the mildest.

    ``DROP``: ignore the message, count it, go on with the last good one. ``BRAKE``: bring the commanded
    speed to zero under the policy, then stand. ``STOP``: damp every joint until an operator lets go of it.
    """

    DROP = "drop"
    BRAKE = "brake"
    STOP = "stop"


_D, _B, _S = Reaction


class Fault(str, Enum):
    """What can be wrong. Its value is its name."""

    reaction: Reaction
    lasts: float  # how long the condition holds before it is a fault [s]
    within: float  # greatest time from the onset to the first command that shows the reaction [s]
    meaning: str

    def __new__(cls, name: str, reaction: Reaction, lasts: float, delay: float, meaning: str) -> Fault:
        """A line of the table: times in milliseconds, ``delay`` after the condition has lasted."""
        fault = str.__new__(cls, name)
        fault._value_, fault.reaction, fault.lasts = name, reaction, 1e-3 * lasts
        fault.within, fault.meaning = 1e-3 * (lasts + delay), meaning
        return fault

    STATE_DUPLICATE = "state-duplicate", _D, 0, 1, "a state came twice"
    STATE_OUT_OF_ORDER = "state-out-of-order", _D, 0, 1, "a state is older than one already used"
    STATE_NOT_FINITE = "state-not-finite", _D, 0, 1, "a state holds NaN or infinity"
    STATE_IMPLAUSIBLE = "state-implausible", _D, 0, 1, "a state holds what no joint, gyro or battery can show"
    STATE_LOST = "state-lost", _D, 0, 1, "sequence numbers are missing"
    STATE_STALE = "state-stale", _S, 30, 2, "no usable state for 30 ms"
    STATE_FROZEN = "state-frozen", _S, 20, 2, "states go on, but their content does not change for 20 ms"
    ENCODER_STUCK = "encoder-stuck", _S, 20, 2, "a joint moves, but its position does not change for 20 ms"
    INERTIAL_STUCK = "inertial-stuck", _S, 20, 2, "joints move, orientation and gyro do not change for 20 ms"
    JOINT_LIMIT = "joint-limit", _S, 5, 2, "a joint is far beyond its stop for 5 ms"
    OVERSPEED = "overspeed", _S, 5, 2, "a joint turns far above its motor's no-load speed for 5 ms"
    OVERTORQUE = "overtorque", _S, 10, 2, "a drive gives far more than its peak torque for 10 ms"
    BUS_LOW = "bus-low", _B, 50, 2, "bus voltage below its lowest for 50 ms"
    BUS_HIGH = "bus-high", _S, 10, 2, "bus voltage above its highest for 10 ms"
    FALL = "fall", _S, 2, 2, "the trunk is tilted by more than 60 degrees for 2 ms"
    COLLAPSE = "collapse", _S, 300, 2, "no leg carries the trunk for 0.3 s"
    TUMBLE = "tumble", _S, 20, 2, "the trunk turns faster than any gait for 20 ms"
    DRIVE_FAULT = "drive-fault", _S, 0, 2, "the robot reports a fault of a drive"
    WATCHDOG_EXPIRED = "watchdog-expired", _S, 0, 2, "the robot damps its joints by itself"
    COMMANDS_UNANSWERED = "commands-unanswered", _S, 100, 2, "the robot accepts no command for 0.1 s"
    COMMANDS_FOREIGN = "commands-foreign", _S, 0, 2, "the robot obeys a command that was never sent to it"
    POLICY_INVALID = "policy-invalid", _S, 0, 1, "the policy fails or gives NaN"
    POLICY_LATE = "policy-late", _B, 0, 1000, "ten of the last fifty policy steps came more than 5 ms late"
    LOOP_STALLED = "loop-stalled", _S, 0, 1, "the control loop itself stood still for 40 ms"
    STAND_FAILED = "stand-failed", _S, 0, 2, "the legs do not reach the standing pose"
    BRAKE_FAILED = "brake-failed", _S, 0, 2, "braking takes longer than it can"
    FIX_INVALID = "fix-invalid", _D, 0, 1, "a position fix is not finite, absurd or old"
    SOURCE_INVALID = "source-invalid", _D, 0, 21, "the command source fails, or its velocity is not finite"
    SOURCE_LOST = "source-lost", _B, 200, 22, "the command source is silent for 0.2 s"

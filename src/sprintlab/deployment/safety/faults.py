"""Every fault the controller knows, and what it does about each within which time."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Reaction(str, Enum):
    """What the controller does about a fault, from the mildest.

    ``DROP``: ignore the message, count it, go on with the last good one. ``BRAKE``: bring the commanded
    speed to zero under the policy, then stand. ``STOP``: damp every joint until an operator lets go of it.
    """

    DROP = "drop"
    BRAKE = "brake"
    STOP = "stop"


class Fault(str, Enum):
    """What can be wrong; ``RESPONSES`` says what follows."""

    STATE_DUPLICATE = "state-duplicate"
    STATE_OUT_OF_ORDER = "state-out-of-order"
    STATE_NOT_FINITE = "state-not-finite"
    STATE_IMPLAUSIBLE = "state-implausible"
    STATE_LOST = "state-lost"
    STATE_STALE = "state-stale"
    STATE_FROZEN = "state-frozen"
    ENCODER_STUCK = "encoder-stuck"
    INERTIAL_STUCK = "inertial-stuck"
    JOINT_LIMIT = "joint-limit"
    OVERSPEED = "overspeed"
    OVERTORQUE = "overtorque"
    BUS_LOW = "bus-low"
    BUS_HIGH = "bus-high"
    FALL = "fall"
    COLLAPSE = "collapse"
    TUMBLE = "tumble"
    DRIVE_FAULT = "drive-fault"
    WATCHDOG_EXPIRED = "watchdog-expired"
    COMMANDS_UNANSWERED = "commands-unanswered"
    COMMANDS_FOREIGN = "commands-foreign"
    POLICY_INVALID = "policy-invalid"
    POLICY_LATE = "policy-late"
    LOOP_STALLED = "loop-stalled"
    STAND_FAILED = "stand-failed"
    BRAKE_FAILED = "brake-failed"
    FIX_INVALID = "fix-invalid"
    SOURCE_INVALID = "source-invalid"
    SOURCE_LOST = "source-lost"


class Response(NamedTuple):
    """The reaction to a fault.

    Attributes:
        reaction: the controller's reaction.
        within: greatest time from the fault's onset to the first command that shows the reaction [s].
        meaning: the fault in words.
    """

    reaction: Reaction
    within: float
    meaning: str


TICK = 0.001
"""One step of the control loop [s]: nothing can be noticed faster."""

_D, _B, _S = Reaction.DROP, Reaction.BRAKE, Reaction.STOP

RESPONSES: dict[Fault, Response] = {
    Fault.STATE_DUPLICATE: Response(_D, TICK, "a state came twice"),
    Fault.STATE_OUT_OF_ORDER: Response(_D, TICK, "a state is older than one already used"),
    Fault.STATE_NOT_FINITE: Response(_D, TICK, "a state holds NaN or infinity"),
    Fault.STATE_IMPLAUSIBLE: Response(_D, TICK, "a state holds what no joint, gyro or battery can show"),
    Fault.STATE_LOST: Response(_D, TICK, "sequence numbers are missing"),
    Fault.STATE_STALE: Response(_S, 0.032, "no usable state for 30 ms"),
    Fault.STATE_FROZEN: Response(_S, 0.022, "states go on, but their content does not change for 20 ms"),
    Fault.ENCODER_STUCK: Response(_S, 0.022, "a joint moves, but its position does not change for 20 ms"),
    Fault.INERTIAL_STUCK: Response(
        _S, 0.022, "joints move, but orientation and gyro do not change for 20 ms"
    ),
    Fault.JOINT_LIMIT: Response(_S, 0.007, "a joint is far beyond its stop for 5 ms"),
    Fault.OVERSPEED: Response(_S, 0.007, "a joint turns far above its motor's no-load speed for 5 ms"),
    Fault.OVERTORQUE: Response(_S, 0.012, "a drive gives far more than its peak torque for 10 ms"),
    Fault.BUS_LOW: Response(_B, 0.052, "bus voltage below its lowest for 50 ms"),
    Fault.BUS_HIGH: Response(_S, 0.012, "bus voltage above its highest for 10 ms"),
    Fault.FALL: Response(_S, 0.004, "the trunk is tilted by more than 60 degrees for 2 ms"),
    Fault.COLLAPSE: Response(_S, 0.302, "no leg carries the trunk for 0.3 s"),
    Fault.TUMBLE: Response(_S, 0.022, "the trunk turns faster than any gait for 20 ms"),
    Fault.DRIVE_FAULT: Response(_S, 2 * TICK, "the robot reports a fault of a drive"),
    Fault.WATCHDOG_EXPIRED: Response(_S, 2 * TICK, "the robot damps its joints by itself"),
    Fault.COMMANDS_UNANSWERED: Response(_S, 0.102, "the robot accepts no command for 0.1 s"),
    Fault.COMMANDS_FOREIGN: Response(_S, 2 * TICK, "the robot obeys a command that was never sent to it"),
    Fault.POLICY_INVALID: Response(_S, TICK, "the policy fails or gives NaN"),
    Fault.POLICY_LATE: Response(_B, 1.0, "ten of the last fifty policy steps came more than 5 ms late"),
    Fault.LOOP_STALLED: Response(
        _S, TICK, "the control loop itself stood still for 40 ms, or its clock ran back as far"
    ),
    Fault.STAND_FAILED: Response(_S, 2 * TICK, "the legs do not reach the standing pose"),
    Fault.BRAKE_FAILED: Response(_S, 2 * TICK, "braking takes longer than it can"),
    Fault.FIX_INVALID: Response(_D, TICK, "a position fix is not finite, absurd or old"),
    Fault.SOURCE_INVALID: Response(_D, 0.021, "a velocity command is not finite, or old"),
    Fault.SOURCE_LOST: Response(_B, 0.222, "the command source is silent for 0.2 s"),
}
"""The reaction to every fault; ``docs/deployment.md`` prints this table."""

"""The modes of the controller and the ways between them."""

from __future__ import annotations

from enum import Enum

from sprintlab.deployment.interface import Request


class Mode(str, Enum):
    """What the controller does.

    ``PASSIVE``: drives off. ``STAND_UP``: tuck the legs, then rise. ``STAND``: hold the standing pose, or,
    after a run, keep the balance under the policy. ``RUN``: the policy drives. ``LIE_DOWN``: after a run step
    the feet below the robot; sink on the belly, then damp. ``STOP``: damp until an operator lets go.
    """

    PASSIVE = "passive"
    STAND_UP = "stand-up"
    STAND = "stand"
    RUN = "run"
    LIE_DOWN = "lie-down"
    STOP = "stop"


ACTIVE_MODES = frozenset({Mode.STAND_UP, Mode.STAND, Mode.RUN, Mode.LIE_DOWN})
"""Modes in which the joints are driven; here a lost robot is a fault."""

REQUESTED: dict[tuple[Mode, Request], Mode] = {
    (Mode.PASSIVE, Request.STAND): Mode.STAND_UP,
    (Mode.STAND_UP, Request.LIE_DOWN): Mode.LIE_DOWN,
    (Mode.STAND, Request.RUN): Mode.RUN,
    (Mode.STAND, Request.LIE_DOWN): Mode.LIE_DOWN,
    (Mode.RUN, Request.STAND): Mode.STAND,
    (Mode.RUN, Request.LIE_DOWN): Mode.LIE_DOWN,
    (Mode.STOP, Request.PASSIVE): Mode.PASSIVE,
}
"""Where a request leads. Every other request is ignored, but ``STOP``, which is obeyed in every active mode.
From ``RUN`` the way goes through a brake."""

"""Whether a policy may drive a robot, and how fast: what its audit says of a simulated trial."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from sprintlab.control.policy import SHIPPED_POLICIES
from sprintlab.core.errors import SprintlabError

if TYPE_CHECKING:
    from sprintlab.control import Policy
    from sprintlab.robots import RobotDescription

HARMFUL = ("foot force", "gear torque")
"""Items of the audit that break a robot."""
TRIED_SPEEDS = (12.0, 10.0, 8.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0)
"""Top speeds of the trials that look for the highest one that a policy may be asked for [m/s]."""
STORED_SPEEDS = SHIPPED_POLICIES / "cleared_speeds.json"
"""What ``cleared_speed`` found for the policies of the package: SHA-256 of the file to speed [m/s]."""


class ClearanceError(SprintlabError):
    """A policy that falls or would break the robot in simulation."""


def require_clearance(
    name: str, policy: Policy, robot: RobotDescription, top_speed: float, *, self_paced: bool
) -> None:
    """Run one nominal trial up to ``top_speed``; refuse a policy that falls or overloads feet or gears in it.

    Args:
        name: the policy's name, as the operator gave it.
        policy: the policy to judge.
        robot: the robot that it is to drive.
        top_speed: highest command [m/s].
        self_paced: whether the command will be held near the measured speed.

    Raises:
        ClearanceError: the policy fell, or the audit failed on foot force or gear torque.
    """
    found = objections(policy, robot, top_speed, self_paced=self_paced)
    if found:
        raise ClearanceError(
            f"{name} may not drive a robot at up to {top_speed:g} m/s: in simulation "
            f"{'; '.join(found)}. Lower --top-speed, or give --despite-audit {name}"
        )


def stored_speed(policy: Policy) -> float | None:
    """What ``cleared_speed`` found for a policy of the package [m/s]; None for any other."""
    return json.loads(STORED_SPEEDS.read_text(encoding="utf-8")).get(policy.digest)


def cleared_speed(policy: Policy, robot: RobotDescription, *, self_paced: bool) -> float:
    """The highest of ``TRIED_SPEEDS`` with no objection in its trial [m/s]; 0 where none is left."""
    passed = (speed for speed in TRIED_SPEEDS if not objections(policy, robot, speed, self_paced=self_paced))
    return next(passed, 0.0)


def objections(policy: Policy, robot: RobotDescription, top_speed: float, *, self_paced: bool) -> list[str]:
    """What one nominal trial up to ``top_speed`` [m/s] says against a policy, in words."""
    from sprintlab.evaluation.report_text import audit_failure
    from sprintlab.evaluation.trial import TrialRequest, run_trial

    trial = run_trial(policy, robot, TrialRequest(top_speed=top_speed, self_paced=self_paced))
    found = [audit_failure(item) for item in trial.audit.failed if item.name in HARMFUL]
    if trial.fall_time is not None:
        found.insert(0, f"it fell after {trial.fall_time:.1f} s ({trial.fall_reason})")
    return found

"""Whether a policy may drive a robot: its audit at the speed that the operator may command."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sprintlab.core.errors import SprintlabError

if TYPE_CHECKING:
    from sprintlab.control import Policy
    from sprintlab.evaluation.results import TrialResult
    from sprintlab.robots import RobotDescription

HARMFUL = ("foot force", "gear torque")
"""Items of the audit that break a robot."""


class ClearanceError(SprintlabError):
    """A policy that falls or would break the robot in simulation."""


def require_clearance(
    name: str,
    policy: Policy,
    robot: RobotDescription,
    top_speed: float,
    *,
    self_paced: bool,
    despite: str | None,
) -> None:
    """Run one nominal trial up to ``top_speed``; refuse a policy that falls or overloads feet or gears in it.

    Args:
        name: of the policy, as the operator gave it.
        policy: to judge.
        robot: that it is to drive.
        top_speed: highest command [m/s].
        self_paced: whether the command will be held near the measured speed.
        despite: a policy's name to let it drive whatever the audit says: no trial is run then.

    Raises:
        ClearanceError: the policy fell, or the audit failed on foot force or gear torque.
        SprintlabError: ``despite`` names another policy.
    """
    if despite is not None:
        if despite != name:
            raise SprintlabError(f"--despite-audit names {despite!r}, but the policy is {name!r}")
        return
    from sprintlab.evaluation.trial import TrialRequest, run_trial

    trial = run_trial(policy, robot, TrialRequest(top_speed=top_speed, self_paced=self_paced))
    objections = list(_objections(trial))
    if objections:
        raise ClearanceError(
            f"{name} may not drive a robot at up to {top_speed:g} m/s: in simulation "
            f"{'; '.join(objections)}. Lower --top-speed, or give --despite-audit {name}"
        )


def _objections(trial: TrialResult) -> list[str]:
    """What speaks against a policy, in words."""
    from sprintlab.evaluation.report_text import audit_failure

    found = [audit_failure(item) for item in trial.audit.failed if item.name in HARMFUL]
    if trial.fall_time is not None:
        found.insert(0, f"it fell after {trial.fall_time:.1f} s ({trial.fall_reason})")
    return found

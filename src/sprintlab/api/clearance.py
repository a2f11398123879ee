"""Whether a policy may drive a robot, and how fast: what its audit says of a simulated trial."""

from __future__ import annotations

import json
from collections.abc import Callable

from sprintlab.control import Policy
from sprintlab.control.policy import SHIPPED_POLICIES
from sprintlab.core.errors import SprintlabError
from sprintlab.evaluation import trial as trials
from sprintlab.evaluation.report_text import audit_failure
from sprintlab.robots import RobotDescription

HARMFUL = ("foot force", "gear torque")
"""Items of the audit that break a robot."""
TRIED_SPEEDS = (13.0, 12.0, 10.0, 8.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0)
"""Top speeds of the trials that look for the highest one that a policy may be asked for [m/s]."""
STORED_SPEEDS = SHIPPED_POLICIES / "cleared_speeds.json"
"""What ``cleared_speed`` found for the policies of the package: SHA-256 of the file to speed [m/s]."""


class ClearanceError(SprintlabError):
    """A policy that falls or would break the robot in simulation."""


def permitted_speed(
    name: str,
    policy: Policy,
    robot: RobotDescription,
    asked: float | None,
    *,
    self_paced: bool,
    needed: bool,
    tell: Callable[[str], None],
) -> float:
    """The highest speed that a policy may be asked for [m/s].

    Args:
        asked: the operator's choice [m/s]; ``None`` takes the highest at which a simulated trial passes.
        self_paced: whether the command will be held near the measured speed.
        needed: whether a trial must pass, as for a robot that may be real.
        tell: told what is simulated, and why this speed.

    Raises:
        ClearanceError: a trial must pass, and the policy falls in it or overloads feet or gears.
    """
    if asked is not None and not needed:
        return asked
    if asked is not None:
        tell(f"auditing {name} at {asked:g} m/s in simulation first")
        if found := objections(policy, robot, asked, self_paced=self_paced):
            raise ClearanceError(
                f"{name} may not drive a robot at up to {asked:g} m/s: in simulation "
                f"{'; '.join(found)}. Lower --top-speed, or give --despite-audit {name}"
            )
        return asked
    speed = stored_speed(policy)
    if speed is None:
        tell(f"looking in simulation for the highest speed at which {name} passes its audit")
        speed = cleared_speed(policy, robot, self_paced=self_paced)
    least, passes = TRIED_SPEEDS[-1], f"{name} passes its audit in simulation"
    if not speed and needed:
        raise ClearanceError(
            f"{passes} at no speed from {least:g} m/s on: give --top-speed and --despite-audit {name}"
        )
    why = f"the highest at which {passes}" if speed else f"although {passes} at no speed"
    tell(f"top speed: {speed or least:g} m/s, {why}")
    return speed or least


def stored_speed(policy: Policy) -> float | None:
    """What ``cleared_speed`` found for a policy of the package [m/s]; None for any other."""
    return json.loads(STORED_SPEEDS.read_text(encoding="utf-8")).get(policy.digest)


def cleared_speed(policy: Policy, robot: RobotDescription, *, self_paced: bool) -> float:
    """The highest of ``TRIED_SPEEDS`` with no objection in its trial [m/s]; 0 where none is left."""
    passed = (speed for speed in TRIED_SPEEDS if not objections(policy, robot, speed, self_paced=self_paced))
    return next(passed, 0.0)


def objections(policy: Policy, robot: RobotDescription, top_speed: float, *, self_paced: bool) -> list[str]:
    """Objections of one nominal trial up to ``top_speed`` [m/s] to a policy, in words."""
    trial = trials.run_trial(policy, robot, trials.TrialRequest(top_speed=top_speed, self_paced=self_paced))
    found = [audit_failure(item) for item in trial.audit.failed if item.name in HARMFUL]
    if trial.fall_time is not None:
        found.insert(0, f"it fell after {trial.fall_time:.1f} s ({trial.fall_reason})")
    return found

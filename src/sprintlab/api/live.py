"""``play``: a robot to drive in the browser."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sprintlab.api.policies import (
    RobotChoice,
    fitting_policies,
    named_policies,
    policy_path,
    robot_of,
    shipped_policies_opened,
)
from sprintlab.core.arguments import checked
from sprintlab.core.extras import require_package

if TYPE_CHECKING:
    from sprintlab.viewer.live import Session
    from sprintlab.viewer.page import Page


@checked
def play(
    policies: Sequence[str] = (),
    robot: RobotChoice = None,
    *,
    host: str = "localhost",
    port: int = 8080,
    gamepad: Path | None = None,
    duration: float | None = None,
) -> Page:
    """Serve a page on which a robot is driven: ``.address`` says where, ``.run()`` simulates until its end.

    Args:
        policies: policy files, or names of policies of the package; those that fit the robot when left out.
        robot: name, folder or table; the first policy's when left out.
        host: interface to listen on; 0.0.0.0 lets other machines in.
        port: first port to try.
        gamepad: device to drive with too.
        duration: stop after this time [s]; run until interrupted when left out.

    Raises:
        SprintlabError: viser is missing, policy or gamepad are refused, or nothing can be served there.
    """
    require_package("viser", extra="play", use="sprintlab play")
    from sprintlab.viewer.page import Page, PageOptions

    options = PageOptions(host=host, port=port, duration=duration, gamepad=gamepad)
    return Page(live_session(policies, robot), options)


def live_session(names: Sequence[str], robot: RobotChoice) -> Session:
    """The running robot behind such a page, with the policies that it can switch between.

    Raises:
        SprintlabError: a policy or the robot is refused, or none fits.
    """
    from sprintlab.robots import load_robot
    from sprintlab.viewer.live import Session

    opened = named_policies(tuple(names)) or shipped_policies_opened()
    described = load_robot(robot or _robot_of_first(names, opened))
    return Session(described, opened if names else fitting_policies(opened, described))


def _robot_of_first(names: Sequence[str], opened: dict[str, Any]) -> str:
    label, policy = next(iter(opened.items()))
    return robot_of(policy, policy_path(names[0]).name if names else label)

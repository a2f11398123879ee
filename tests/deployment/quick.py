"""Runs of half their cost, for tests that are about neither physics nor how a robot stands up."""

import sys
from collections.abc import Callable

from sprintlab.deployment.controller import loop, modes, motion
from sprintlab.deployment.simulator import loop as simulator_loop
from sprintlab.plant import PlantOptions

COARSE = {"timestep": 0.0005, "contact_time_constant": 0.001}
"""Options of a plant: steps as long as those of the motors, which act as often as ever."""


def hurry(change: Callable[[object, str, object], None] = setattr) -> None:
    """Stand up and sink in four fifths of their times; harder, and a policy falls on coarse steps."""
    for name in ("TUCK_TIME", "RISE_TIME", "SINK_TIME"):
        change(motion, name, 0.8 * getattr(motion, name))


def main(*arguments: str) -> None:
    """``sprintlab ARGUMENTS`` in a hurry, on coarse steps; in lock-step it looks at the bus less often.

    It changes the process that it runs in.
    """
    from sprintlab.cli.main import main as sprintlab

    hurry()
    modes._CALM_PATIENCE = 1.0  # twice what a robot at rest is watched for
    PlantOptions.__init__.__kwdefaults__.update(COARSE)
    for module in (loop, simulator_loop):
        module._POLL = 2e-4
    sys.exit(sprintlab(arguments))

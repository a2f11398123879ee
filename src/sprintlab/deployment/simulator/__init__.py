"""A simulated robot behind the robot bus: plant, sensors, link and watchdog."""

from sprintlab.deployment.simulator.link import Link, LinkOptions
from sprintlab.deployment.simulator.loop import PaceOptions, SimulatorReport, run_simulator
from sprintlab.deployment.simulator.options import SensorNoise, SimulatorOptions
from sprintlab.deployment.simulator.robot import SimulatedRobot
from sprintlab.deployment.simulator.world import SimulatedWorld

__all__ = [
    "Link",
    "LinkOptions",
    "PaceOptions",
    "SensorNoise",
    "SimulatedRobot",
    "SimulatedWorld",
    "SimulatorOptions",
    "SimulatorReport",
    "run_simulator",
]

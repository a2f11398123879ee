"""A simulated robot behind the robot bus: plant, sensors, link and watchdog."""

from sprintlab.deployment.simulator.loop import run_simulator as run_simulator
from sprintlab.deployment.simulator.robot import TYPICAL_NOISE as TYPICAL_NOISE
from sprintlab.deployment.simulator.robot import SimulatedRobot as SimulatedRobot
from sprintlab.deployment.simulator.robot import SimulatorOptions as SimulatorOptions
from sprintlab.deployment.simulator.world import Link as Link
from sprintlab.deployment.simulator.world import LinkOptions as LinkOptions
from sprintlab.deployment.simulator.world import SimulatedWorld as SimulatedWorld

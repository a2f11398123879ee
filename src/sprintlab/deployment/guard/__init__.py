"""What keeps the robot, and those around it, whole: faults, monitors, limits of every command."""

from sprintlab.deployment.guard.faults import Fault as Fault
from sprintlab.deployment.guard.faults import Reaction as Reaction
from sprintlab.deployment.guard.guard import CommandGuard as CommandGuard
from sprintlab.deployment.guard.guard import GuardedServo as GuardedServo
from sprintlab.deployment.guard.guard import implied_torque as implied_torque
from sprintlab.deployment.guard.monitors import BodyMonitor as BodyMonitor
from sprintlab.deployment.guard.monitors import Persistence as Persistence
from sprintlab.deployment.guard.monitors import StateMonitor as StateMonitor
from sprintlab.deployment.guard.velocity import VelocityLimiter as VelocityLimiter

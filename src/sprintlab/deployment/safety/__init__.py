"""What keeps the robot, and those around it, whole: monitors, limits, reactions."""

from sprintlab.deployment.safety.faults import RESPONSES as RESPONSES
from sprintlab.deployment.safety.faults import Fault as Fault
from sprintlab.deployment.safety.faults import Reaction as Reaction
from sprintlab.deployment.safety.guard import CommandGuard as CommandGuard
from sprintlab.deployment.safety.guard import GuardedServo as GuardedServo
from sprintlab.deployment.safety.guard import implied_torque as implied_torque
from sprintlab.deployment.safety.monitors import BodyMonitor as BodyMonitor
from sprintlab.deployment.safety.monitors import Persistence as Persistence
from sprintlab.deployment.safety.monitors import StateMonitor as StateMonitor
from sprintlab.deployment.safety.monitors import trunk_tilt as trunk_tilt
from sprintlab.deployment.safety.settings import SafetySettings as SafetySettings
from sprintlab.deployment.safety.source import SourceMonitor as SourceMonitor
from sprintlab.deployment.safety.source import VelocityLimiter as VelocityLimiter
from sprintlab.deployment.safety.source import VelocityLimits as VelocityLimits

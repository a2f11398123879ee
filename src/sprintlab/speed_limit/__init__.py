"""How fast a robot could run at most: motors, legs and ground, before any training."""

from sprintlab.speed_limit.analysis import scalings as scalings
from sprintlab.speed_limit.analysis import speed_limit as speed_limit
from sprintlab.speed_limit.analysis import stride_facts as stride_facts
from sprintlab.speed_limit.runner import runner_from_robot as runner_from_robot
from sprintlab.speed_limit.search import Fastest as Fastest
from sprintlab.speed_limit.search import SearchSettings as SearchSettings
from sprintlab.speed_limit.search import fastest_stride as fastest_stride
from sprintlab.speed_limit.stride import evaluate as evaluate
from sprintlab.speed_limit.stride import violations as violations

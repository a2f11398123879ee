"""How fast a robot could run at most: motors, legs and ground, before any training."""

from sprintlab.speed_limit.analysis import (
    LIMITS_TO_LIFT,
    Lifted,
    Sensitivity,
    SpeedLimit,
    StrideFacts,
    TrainedSpeed,
    scalings,
    speed_limit,
    stride_facts,
    trained_speeds,
)
from sprintlab.speed_limit.leg import PlanarLeg, planar_leg
from sprintlab.speed_limit.runner import Runner, runner_from_robot
from sprintlab.speed_limit.search import Fastest, SearchSettings, fastest_stride
from sprintlab.speed_limit.stride import Stride, evaluate, violations

__all__ = [
    "LIMITS_TO_LIFT",
    "Fastest",
    "Lifted",
    "PlanarLeg",
    "Runner",
    "SearchSettings",
    "Sensitivity",
    "SpeedLimit",
    "Stride",
    "StrideFacts",
    "TrainedSpeed",
    "evaluate",
    "fastest_stride",
    "planar_leg",
    "runner_from_robot",
    "scalings",
    "speed_limit",
    "stride_facts",
    "trained_speeds",
    "violations",
]

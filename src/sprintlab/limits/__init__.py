"""How fast a robot could run at most: motors, legs and ground, before any training."""

from sprintlab.limits.analysis import (
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
from sprintlab.limits.figure import limit_figure
from sprintlab.limits.leg import PlanarLeg, planar_leg
from sprintlab.limits.runner import Runner, runner_from_robot
from sprintlab.limits.search import Fastest, SearchSettings, fastest_stride
from sprintlab.limits.stride import Stride, evaluate, violations

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
    "limit_figure",
    "planar_leg",
    "runner_from_robot",
    "scalings",
    "speed_limit",
    "stride_facts",
    "trained_speeds",
    "violations",
]

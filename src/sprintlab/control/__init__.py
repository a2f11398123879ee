"""What stands between a policy and the joints: observation, filters, action mapping."""

from sprintlab.control.action import joint_targets, pd_torque
from sprintlab.control.filters import LowPass, low_pass, low_pass_coefficient
from sprintlab.control.observation import (
    FRAME_SIZE,
    JOINT_COUNT,
    PROPRIOCEPTION_SIZE,
    ObservationLayout,
    ObservationTerm,
    Proprioception,
    fill_history,
    join_proprioception,
    network_input,
    observation_frame,
    projected_gravity,
    push_history,
    split_proprioception,
    update_history,
)

__all__ = [
    "FRAME_SIZE",
    "JOINT_COUNT",
    "PROPRIOCEPTION_SIZE",
    "LowPass",
    "ObservationLayout",
    "ObservationTerm",
    "Proprioception",
    "fill_history",
    "join_proprioception",
    "joint_targets",
    "low_pass",
    "low_pass_coefficient",
    "network_input",
    "observation_frame",
    "pd_torque",
    "projected_gravity",
    "push_history",
    "split_proprioception",
    "update_history",
]

"""Options that make no sense are refused by the name of their field."""

import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.deployment.controller import LoopOptions
from sprintlab.deployment.safety import SafetySettings, VelocityLimits
from sprintlab.deployment.simulator import LinkOptions, SensorNoise, SimulatorOptions

WRONG = [
    (SafetySettings, "safety", {"state_timeout": 0.0}),
    (VelocityLimits, "velocity_limits", {"forward": -1.0}),
    (VelocityLimits, "velocity_limits", {"braking": 0.0}),
    (LinkOptions, "link", {"delay": -0.1}),
    (LinkOptions, "link", {"jitter": 2.0}),
    (LinkOptions, "link", {"loss": float("nan")}),
    (SimulatorOptions, "simulator", {"start": "flying"}),
    (SimulatorOptions, "simulator", {"fix_rate": -1.0}),
    (SimulatorOptions, "simulator", {"watchdog_timeout": 0.0}),
    (SimulatorOptions, "simulator", {"seed": -1}),
    (SensorNoise, "noise", {"joint_torque": -1.0}),
    (LoopOptions, "loop", {"priority": 100}),
    (LoopOptions, "loop", {"duration": 0.0}),
    (LoopOptions, "loop", {"patience": -1.0}),
    (LoopOptions, "loop", {"core": -1}),
]


@pytest.mark.parametrize(("options", "group", "wrong"), WRONG)
def test_impossible_options_are_refused(options, group, wrong):
    with pytest.raises(InvalidValueError, match=f"{group}.{next(iter(wrong))}"):
        options(**wrong)

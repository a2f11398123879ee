"""Options that make no sense are refused by the name of their field."""

import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.deployment.controller import LoopOptions
from sprintlab.deployment.guard import VelocityLimiter
from sprintlab.deployment.simulator import LinkOptions, PaceOptions, SimulatorOptions

WRONG = [
    (VelocityLimiter, {"top_speed": -1.0}),
    (LinkOptions, {"loss": float("nan")}),
    (SimulatorOptions, {"watchdog_timeout": 0.0}),
    (PaceOptions, {"duration": 0.0}),
    (LoopOptions, {"priority": 100}),
]


@pytest.mark.parametrize(("options", "wrong"), WRONG)
def test_impossible_options_are_refused(options, wrong):
    with pytest.raises(InvalidValueError, match=next(iter(wrong))):
        options(**wrong)

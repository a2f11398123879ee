"""Options that make no sense are refused by the name of their field."""

import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.deployment.controller import LoopOptions
from sprintlab.deployment.guard import VelocityLimiter
from sprintlab.deployment.simulator import LinkOptions, PaceOptions, SimulatorOptions

WRONG = [
    (VelocityLimiter, {"top_speed": -1.0}),
    *((LinkOptions, wrong) for wrong in ({"delay": -0.1}, {"jitter": 2.0}, {"loss": float("nan")})),
    *((SimulatorOptions, wrong) for wrong in ({"start": "flying"}, {"fix_rate": -1.0}, {"seed": -1})),
    *((SimulatorOptions, wrong) for wrong in ({"watchdog_timeout": 0.0}, {"noise": -1.0})),
    *((PaceOptions, wrong) for wrong in ({"speed_factor": 0.0}, {"duration": -1.0})),
    *((LoopOptions, wrong) for wrong in ({"priority": 100}, {"duration": 0.0}, {"core": -1})),
]


@pytest.mark.parametrize(("options", "wrong"), WRONG)
def test_impossible_options_are_refused(options, wrong):
    with pytest.raises(InvalidValueError, match=next(iter(wrong))):
        options(**wrong)

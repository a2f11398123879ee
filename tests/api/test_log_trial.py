"""A log as a trial: what is drawn of it, and which logs hold nothing that could be drawn."""

import msgspec
import numpy as np
import pytest
from tests.deployment.log.test_log import FACTS, tick

from sprintlab.api.log_trial import logged_run
from sprintlab.deployment.log import LogError, McapRunLog, read_log
from sprintlab.robots import load_robot

pytest.importorskip("mcap")
ROBOT = load_robot("bp2")


def run_of(path, *, count=1000, **changes):
    """The trial of a log of so many steps; each change is a function of the step's number."""
    log = McapRunLog(path, FACTS, wait=True)
    for number in range(1, count + 1):
        made = tick(number, fix=number % 100 == 1, state=number != 1)
        log.write(msgspec.structs.replace(made, **{name: value(number) for name, value in changes.items()}))
    log.close()
    return logged_run(read_log(path), ROBOT)


def test_the_run_of_a_log_is_taken_as_it_is(tmp_path):
    run = run_of(tmp_path / "run.mcap")
    assert len(run.fix_time) == 10 and len(run.command_time) == 50
    np.testing.assert_allclose(run.command[:, 0], 3.0)
    assert run.trial.trajectory.time[-1] == pytest.approx(0.996, abs=0.003)
    unknown = ("pad_deflection", "foot_force", "mean_duty", "stance_time", "slip_per_step")
    assert all(np.isnan(getattr(run.trial.metrics, name)) for name in unknown)  # no sensor in the feet


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"count": 490}, "less than half a second"),
        ({"time": lambda number: 1.0}, "less than half a second"),
        ({"policy_step": lambda number: False}, "no policy step"),
        ({"state": lambda number: tick(1).state}, "a single state"),
        ({"time": lambda number: 0.001 * number + 900.0 * (number == 1000)}, "gaps"),
    ],
    ids=["short", "one-moment", "no-step", "one-state", "gap"],
)
def test_what_cannot_be_drawn_is_refused_in_one_sentence(tmp_path, changes, match):
    with pytest.raises(LogError, match=match) as refusal:
        run_of(tmp_path / "run.mcap", **changes)
    assert "\n" not in str(refusal.value)

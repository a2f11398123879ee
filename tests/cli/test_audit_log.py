"""``sprintlab audit`` on the log of a run: MCAP in, the same verdict as on the arrays."""

import json

import numpy as np
import pytest
from msgspec.structs import replace

pytest.importorskip("mcap")

from tests.deployment.log.test_log import FACTS, tick

from sprintlab.deployment.log import McapRunLog

COUNT = 200


def write(path):
    """A quarter of the samples asks the hips for 60 N m at the no-load speed, where a motor gives none."""
    log = McapRunLog(path, FACTS, wait=True)
    for number in range(1, COUNT + 1):
        written = tick(number)
        hot = number % 4 == 0
        velocity = np.where(np.arange(12) % 3 == 1, 31.0 if hot else 2.0, 0.0)
        torque = np.where(np.arange(12) % 3 == 1, 60.0 if hot else 10.0, 1.0)
        state = replace(written.state, joint_velocity=velocity, joint_torque=torque)
        log.write(replace(written, state=state))
    log.close()
    assert log.dropped == 0


def test_a_log_is_audited_with_the_names_of_the_robot(call, tmp_path):
    write(tmp_path / "run.mcap")
    outcome = call("audit", tmp_path / "run.mcap", "--motor", "bp2", "--json")
    assert outcome.status == 0, outcome.err
    found = json.loads(outcome.out)
    by_name = {row["name"]: row for row in found["joints"]}
    assert by_name["FL_hip"]["impossible"] == pytest.approx(0.25)
    assert by_name["FL_knee"]["impossible"] == 0.0
    table = call("audit", tmp_path / "run.mcap", "--motor", "bp2")
    assert table.status == 0 and "RR_hip" in table.out and "25" in table.out


def test_what_is_no_log_is_refused_in_one_sentence(call, tmp_path):
    (tmp_path / "run.mcap").write_bytes(b"no log")
    outcome = call("audit", tmp_path / "run.mcap", "--motor", "bp2")
    assert outcome.status == 2 and outcome.err.count("\n") == 1 and "run.mcap" in outcome.err

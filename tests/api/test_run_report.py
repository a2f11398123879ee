"""What a stranger's log may say of the robot and the policy that it is of."""

from types import SimpleNamespace

import pytest

from sprintlab.api.run_reports import report_run
from sprintlab.control import shipped_policy
from sprintlab.core.errors import SprintlabError
from sprintlab.robots.loader import robot_table_path


def test_a_log_does_not_say_which_file_is_read(tmp_path, monkeypatch):
    """Only the name of a known robot counts there: a path is refused."""
    record = SimpleNamespace(facts={"robot": str(robot_table_path("bp2"))})
    monkeypatch.setattr("sprintlab.deployment.log.read_log", lambda path: record)
    with pytest.raises(SprintlabError, match=r"run\.mcap is for robot .*parameters\.toml', unknown here"):
        report_run(tmp_path / "run.mcap", tmp_path / "report")


def test_a_log_does_not_say_which_policy_file_is_opened(tmp_path, monkeypatch):
    """Only the name of a policy that comes with the package counts there: a path is refused."""
    record = SimpleNamespace(facts={"robot": "bp2", "policy": str(shipped_policy("sprint"))})
    monkeypatch.setattr("sprintlab.deployment.log.read_log", lambda path: record)
    monkeypatch.setattr("sprintlab.api.log_trial.logged_run", lambda *_: None)
    with pytest.raises(SprintlabError, match=r"run\.mcap is of policy .*sprint\.onnx', unknown here"):
        report_run(tmp_path / "run.mcap", tmp_path / "report")

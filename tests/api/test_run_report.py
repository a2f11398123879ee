"""What a stranger's log may say of the robot and the policy that it is of."""

from types import SimpleNamespace

import pytest

from sprintlab.api.run_reports import report_run
from sprintlab.control import shipped_policy
from sprintlab.core.errors import SprintlabError, UnwrittenError
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


def test_the_numbers_are_not_lost_with_the_report(tmp_path, monkeypatch):
    def full(*_):
        raise UnwrittenError("cannot write report.html: No space left on device")

    record = SimpleNamespace(facts={"robot": "bp2"})
    monkeypatch.setattr("sprintlab.deployment.log.read_log", lambda path: record)
    monkeypatch.setattr("sprintlab.api.log_trial.logged_run", lambda *_: SimpleNamespace(faults={"fall": 1}))
    monkeypatch.setattr("sprintlab.evaluation.run_report.run_numbers", lambda *_: {"held_speed": 9.0})
    monkeypatch.setattr("sprintlab.api.run_reports._write", full)
    with pytest.raises(UnwrittenError, match="No space left") as refused:
        report_run(tmp_path / "run.mcap", tmp_path / "report", simulate=False)
    numbers = {"held_speed": 9.0, "faults": {"fall": 1}, "facts": record.facts, "folder": None}
    assert refused.value.found.to_dict() == numbers

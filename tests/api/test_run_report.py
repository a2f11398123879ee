"""What a stranger's log may say of the robot that it is of."""

from types import SimpleNamespace

import pytest

from sprintlab.api.run_reports import report_run
from sprintlab.core.errors import SprintlabError
from sprintlab.robots.loader import robot_table_path


def test_a_log_does_not_say_which_file_is_read(tmp_path, monkeypatch):
    """Only the name of a known robot counts there: a path is refused."""
    record = SimpleNamespace(facts={"robot": str(robot_table_path("bp2"))})
    monkeypatch.setattr("sprintlab.deployment.log.read_log", lambda path: record)
    with pytest.raises(SprintlabError, match=r"run\.mcap is for robot .*parameters\.toml', unknown here"):
        report_run(tmp_path / "run.mcap", tmp_path / "report")

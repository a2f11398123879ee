"""Log files of runs: MCAP, written by a process of its own."""

from sprintlab.deployment.log.reader import RunRecord, read_log
from sprintlab.deployment.log.run_log import LogFacts, McapRunLog, check_new_log

__all__ = ["LogFacts", "McapRunLog", "RunRecord", "check_new_log", "read_log"]

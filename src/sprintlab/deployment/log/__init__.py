"""Log files of runs: MCAP, written by a process of its own."""

from sprintlab.deployment.log.reader import RunRecord as RunRecord
from sprintlab.deployment.log.reader import read_log as read_log
from sprintlab.deployment.log.topics import LogError as LogError
from sprintlab.deployment.log.topics import LogFacts as LogFacts
from sprintlab.deployment.log.writer import McapRunLog as McapRunLog
from sprintlab.deployment.log.writer import check_new_log as check_new_log

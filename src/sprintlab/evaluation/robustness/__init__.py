"""How many of many sprints stay upright when everything differs from the nominal robot at once."""

from sprintlab.evaluation.robustness.draws import ALL, CAUSES, NOMINAL, RobustnessRanges, draw_request
from sprintlab.evaluation.robustness.study import StudySettings, run_study
from sprintlab.evaluation.robustness.summary import summarize, wilson_interval

__all__ = [
    "ALL",
    "CAUSES",
    "NOMINAL",
    "RobustnessRanges",
    "StudySettings",
    "draw_request",
    "run_study",
    "summarize",
    "wilson_interval",
]

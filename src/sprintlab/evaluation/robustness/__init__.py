"""How many of many sprints stay upright when everything differs from the nominal robot at once."""

from sprintlab.evaluation.robustness.draws import ALL as ALL
from sprintlab.evaluation.robustness.draws import CAUSES as CAUSES
from sprintlab.evaluation.robustness.draws import NOMINAL as NOMINAL
from sprintlab.evaluation.robustness.draws import RobustnessRanges as RobustnessRanges
from sprintlab.evaluation.robustness.draws import draw_request as draw_request
from sprintlab.evaluation.robustness.study import StudySettings as StudySettings
from sprintlab.evaluation.robustness.study import run_study as run_study
from sprintlab.evaluation.robustness.summary import summarize as summarize
from sprintlab.evaluation.robustness.summary import wilson_interval as wilson_interval

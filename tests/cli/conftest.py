"""A way to call the command in this process, and a race of a policy that stands still."""

import copy
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.short_trials import BRIEF, COARSE, shorten_trials

from sprintlab.cli.main import main
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.race import evaluate_race
from sprintlab.evaluation.results import RaceResult
from sprintlab.robots import RobotDescription


class Outcome(NamedTuple):
    status: int
    out: str
    err: str


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Run ``sprintlab ARGUMENTS`` and return status, stdout and stderr."""

    def run(*arguments: object) -> Outcome:
        try:
            status = main([str(argument) for argument in arguments])
        except SystemExit as stop:
            status = int(stop.code or 0)
        return Outcome(status, *capsys.readouterr())

    return run


@pytest.fixture(scope="session")
def standing_race(policy: Path, robot: RobotDescription) -> RaceResult:
    with pytest.MonkeyPatch.context() as patch:
        shorten_trials(patch.setitem)
        shorten_trials(patch.setitem, BRIEF)
        settings = ProtocolSettings(trials=1, required=1, plant=COARSE)
        return evaluate_race(policy, robot, top_speed=2.0, distance=0.5, settings=settings, workers=1)


@pytest.fixture
def computed(standing_race: RaceResult, monkeypatch: pytest.MonkeyPatch) -> RaceResult:
    """The race as already computed once: what is tested is what becomes of its result."""
    result = copy.deepcopy(standing_race)
    monkeypatch.setattr("sprintlab.evaluation.race.evaluate_race", lambda *_, **__: result)
    return result

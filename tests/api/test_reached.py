"""What a training says at its end."""

import json
import shlex
from pathlib import Path

import pytest

from sprintlab.api.reached import asked_speed, what_was_reached
from sprintlab.core.errors import SprintlabError
from sprintlab.evaluation import reached


def exam(**groups: tuple[float, float, int]) -> dict[str, float]:
    row = {"exam/held": 1.0}
    for name, (held, asked, failed) in groups.items():
        row |= {f"exam/{name}/held": held, f"exam/{name}/asked": asked, f"exam/{name}/limits_failed": failed}
    return row


@pytest.mark.parametrize(
    ("log", "speed"),
    [
        ([], 1.0),
        ([{"speed_p95": 0.2}], 1.0),
        ([{"speed_p95": 7.6}], 8.0),
        ([exam(top=(12.0, 14.5, 2), middle=(11.9, 13.3, 0), low=(11.0, 12.2, 0)), {"speed_p95": 9.0}], 13.25),
        ([exam(top=(5.0, 14.5, 2), middle=(6.0, 13.3, 1), low=(7.2, 12.2, 1))], 7.0),
    ],
)
def test_a_policy_is_asked_for_what_its_best_exam_was(log: list[dict[str, float]], speed: float) -> None:
    assert asked_speed(log) == speed


def test_a_training_that_does_not_run_says_so_and_how_to_go_on(tmp_path: Path, monkeypatch) -> None:
    def refuse(*_: object) -> None:
        raise SprintlabError("the policy does not run")

    folder = tmp_path / "my run"
    folder.mkdir()
    (folder / "log.jsonl").write_text(json.dumps({"speed_p95": 1.0, "seconds": 420.0}) + "\n")
    monkeypatch.setattr(reached, "reached_speed", refuse)
    said, following = what_was_reached(folder, "bp2")
    assert said == "the policy does not run"
    words = shlex.split(str(following).removeprefix("next: "))
    assert words == ["sprintlab", "train", "--resume", "--minutes", "14", "--output", str(folder)]

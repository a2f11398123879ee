"""What a training has reached, and policies that cannot be judged."""

from collections.abc import Callable
from typing import Any

import pytest

from sprintlab.core.errors import SprintlabError
from sprintlab.evaluation import reached
from sprintlab.evaluation.reached import require_a_runner


class Pool:
    """Trials that end as told, by their speed."""

    def __init__(self, make_trial: Callable[..., Any], highest: float) -> None:
        self.make_trial, self.highest, self.asked = make_trial, highest, list[float]()

    def trials(self, requests, most_falls=None):
        self.asked.append(requests[0].top_speed)
        return [
            self.make_trial(r.top_speed, r.top_speed <= self.highest, held_speed=r.top_speed - 0.1)
            for r in requests
        ]

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        pass


@pytest.mark.parametrize(
    ("completed", "held", "words"), [(False, 0.9, "falls after 3.0 s"), (True, 0.02, "holds 0.02 m/s")]
)
def test_what_falls_or_stands_still_cannot_be_judged(make_trial, completed, held, words) -> None:
    class One:
        def trials(self, requests):
            return [make_trial(requests[0].top_speed, completed, held_speed=held)]

    with pytest.raises(SprintlabError, match=words):
        require_a_runner(One(), 1.0)


def test_the_first_speed_that_all_trials_complete_is_reached(make_trial, monkeypatch, robot) -> None:
    pool = Pool(make_trial, highest=10.6)
    monkeypatch.setattr(reached, "TrialPool", lambda *_: pool)
    found = reached.reached_speed("policy.onnx", robot, 12.5)
    assert pool.asked == [1.0, 12.5, 11.5, 10.5]
    assert found.running_speed == pytest.approx(10.4)
    pool.highest = 3.0
    with pytest.raises(SprintlabError, match=r"12\.5, 11\.5, 10\.5, 9\.5 m/s it falls"):
        reached.reached_speed("policy.onnx", robot, 12.5)

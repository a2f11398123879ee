"""What ``sprintlab evaluate`` says of a search: most that was held, and where the audit failed."""

import pytest

from sprintlab.api.evaluations import protocol_numbers
from sprintlab.evaluation.results import ProtocolResult, SpeedResult


@pytest.fixture
def make_speed(make_trial):
    """Three trials at one command, with a joint's speed over its no-load speed."""

    def build(top_speed, held_speed, ratio=0.9):
        trial = make_trial(top_speed, held_speed=held_speed, joint_speed_ratio=(0.9,) * 11 + (ratio,))
        return SpeedResult(top_speed=top_speed, self_paced=False, trials=(trial,) * 3, required=2)

    return build


def test_evaluate_tells_the_most_that_was_held_and_which_commands_failed_the_audit(make_speed):
    speeds = (
        make_speed(7.0, 7.2),
        make_speed(8.0, 7.7),
        make_speed(9.0, 7.9, 1.2),
        make_speed(10.0, 6.1, 1.6),
    )
    numbers = protocol_numbers(ProtocolResult(self_paced=False, speeds=speeds))
    assert numbers["max_velocity_m_s"] == pytest.approx(6.1)
    assert numbers["best"]["top_speed_command_m_s"] == 10.0
    assert list(numbers["best"]["audit_failed"]) == ["joint speed"]
    fastest, clean = numbers["fastest"], numbers["fastest_with_audit_passed"]
    assert fastest["held_speed_m_s"] == pytest.approx(7.9) and fastest["audit_failed"]
    assert clean["top_speed_command_m_s"] == 8.0

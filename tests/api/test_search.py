"""The flags of the search become the protocol's settings."""

import pytest

from sprintlab.api.search import SearchOptions
from sprintlab.core.errors import InvalidValueError
from sprintlab.evaluation.protocol import ProtocolSettings


def test_defaults_are_the_protocols_own_with_whole_metres_first():
    assert SearchOptions().protocol() == ProtocolSettings(first_step=1.0)


@pytest.mark.parametrize(
    ("flags", "first_step"),
    [
        (SearchOptions(grid=0.5), 1.0),
        (SearchOptions(every_speed=True), None),
        (SearchOptions(grid=0.3), None),
        (SearchOptions(grid=1.0), None),
    ],
)
def test_whole_metres_first_only_where_they_are_on_the_grid(flags, first_step):
    assert flags.protocol().first_step == first_step


def test_nine_of_ten_trials_are_required_rounded_up():
    assert SearchOptions(trials=5).protocol().required == 5
    assert SearchOptions(trials=20).protocol().required == 18


def test_no_grid_is_refused():
    with pytest.raises(InvalidValueError, match="grid"):
        SearchOptions(grid=0.0).protocol()


def test_share_of_the_search():
    assert SearchOptions(start=2.0, top=6.0).share(3.0) == 0.25
    assert SearchOptions(start=2.0, top=2.0).share(2.0) == 0.0

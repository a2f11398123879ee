"""The flags of the search become the protocol's settings."""

import pytest

from sprintlab.cli.search_flags import SearchFlags
from sprintlab.core.errors import InvalidValueError
from sprintlab.evaluation.protocol import ProtocolSettings


def test_defaults_are_the_protocols_own_with_whole_metres_first():
    assert SearchFlags().protocol() == ProtocolSettings(first_step=1.0)


@pytest.mark.parametrize(
    ("flags", "first_step"),
    [
        (SearchFlags(grid=0.5), 1.0),
        (SearchFlags(every_speed=True), None),
        (SearchFlags(grid=0.3), None),
        (SearchFlags(grid=1.0), None),
    ],
)
def test_whole_metres_first_only_where_they_are_on_the_grid(flags, first_step):
    assert flags.protocol().first_step == first_step


def test_nine_of_ten_trials_are_required_rounded_up():
    assert SearchFlags(trials=5).protocol().required == 5
    assert SearchFlags(trials=20).protocol().required == 18


def test_no_grid_is_refused():
    with pytest.raises(InvalidValueError, match="grid"):
        SearchFlags(grid=0.0).protocol()


def test_share_of_the_search():
    assert SearchFlags(start=2.0, top=6.0).share(3.0) == 0.25
    assert SearchFlags(start=2.0, top=2.0).share(2.0) == 0.0

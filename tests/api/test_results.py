"""Tables made from numbers: name and unit from a key, what is not known, several columns, records."""

import math

import pytest

from sprintlab.api.results import Result, name_and_unit, quantities, records


def lines(table):
    return [line.split() for line in str(Result(numbers={}, shown=[table])).splitlines()]


@pytest.mark.parametrize(
    ("key", "name", "unit"),
    [
        ("top_speed_m_s", "top speed", "m/s"), ("J_rad2_s", "J", "rad²/s"), ("time_100m_s", "time 100m", "s"),
        ("held_m_s: 0.05", "held: 0.05", "m/s"), ("stride: frequency", "stride: frequency", "Hz"),
        ("falls", "falls", ""),
    ],
)  # fmt: skip
def test_a_key_is_a_name_and_a_unit(key, name, unit):
    assert name_and_unit(key, {"frequency": "Hz"}) == (name, unit)


def test_quantities_show_what_is_known_in_any_column():
    raw = {"speed_m_s": 1.23456, "steady": True, "cause": None, "rows": [{}], "falls": {"tilt": 2}}
    paced = {"speed_m_s": math.nan, "interval": [0.25, 1.0]}
    assert lines(quantities("Title", raw, paced, names=("raw", "paced")))[2:] == [
        ["speed", "1.2346", "-", "m/s"],
        ["steady", "yes", "-"],
        ["falls:", "tilt", "2", "-"],
        ["interval", "-", "0.25,", "1"],
    ]


def test_records_have_a_column_a_key():
    rows = [{"name": "a", "power_W": 1e-17}, {"name": "b", "power_W": 12345.6}]
    assert lines(records("Title", rows))[1:] == [["name", "power", "[W]"], ["a", "0"], ["b", "12346"]]

"""docs/foreign-benches.md: its tables hold the numbers of results/benches/benches.json."""

import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NUMBERS = json.loads((ROOT / "results" / "benches" / "benches.json").read_text(encoding="utf-8"))
PAGE = (ROOT / "docs" / "foreign-benches.md").read_text(encoding="utf-8")
ROWS = [[cell.strip() for cell in line.split("|")[1:-1]] for line in PAGE.splitlines() if line[:1] == "|"]


def rows_of(first, width):
    return [row[1:] for row in ROWS if row[0] == first and len(row) == width]


@pytest.mark.parametrize("found", NUMBERS["predictions"], ids=lambda found: found["split"])
def test_every_prediction_stands_in_a_table(found):
    digits = 2 if found["motor"] == "hej90" else 3
    error = found["error"]
    expected = [
        f"{error['rms']:.{digits}f}",
        f"{100.0 * error['share_of_largest']:.1f} %",
        f"{error['median']:.{digits}f}",
        f"{100.0 * found['error_of_constant']['share_of_largest']:.1f} %",
    ]
    assert expected in rows_of(found["split"], 5)


@pytest.mark.parametrize("key", ["saturation", "gear"])
def test_every_law_stands_in_a_table(key):
    for found in NUMBERS[key]:
        expected = [
            f"{row['error']['rms']:.3f}, {row['criterion_over_best']:.0f}" for row in found["laws"].values()
        ]
        assert expected in rows_of(found["split"], 5)


def test_every_predicted_temperature_stands_in_the_table():
    one, two = ([row for row in NUMBERS["heat"] if row["nodes"] == nodes] for nodes in (1, 2))
    for first, second in zip(one, two, strict=True):
        for run, error in first["held_out"].items():
            cells = [f"{error['rms']:.2f}", f"{second['held_out'][run]['rms']:.2f}", f"{error['rise']:.1f}"]
            assert [run, *cells] in rows_of(first["motor"], 5)


@pytest.mark.parametrize(
    ("split", "name", "digits"),
    [
        ("motor 1, stalled on 27 April: 13 May", "torque_constant", 4),
        ("motor 1, stalled on 27 April: 13 May", "saturation", 3),
        ("motor 2, stalled on 27 April: 13 May", "torque_constant", 4),
        ("motor 2, stalled on 27 April: 13 May", "saturation", 3),
        ("motor 1, stalled, and driving: braking", "coulomb_friction", 3),
        ("motor 2, stalled, and driving: braking", "coulomb_friction", 3),
        ("odd rows: even rows", "torque_constant", 4),
        ("odd rows: even rows", "saturation", 3),
        ("odd rows: even rows", "coulomb_friction", 3),
        ("steps of 35 to 140 N m: steps of 140 N m", "torque_constant", 2),
        ("steps of 35 to 140 N m: steps of 140 N m", "saturation", 3),
        ("steps of 35 to 140 N m: steps of 140 N m", "coulomb_friction", 2),
        ("steps of 35 to 140 N m: steps of 140 N m", "gear_efficiency", 3),
    ],
)
def test_found_parameters_stand_on_the_page(split, name, digits):
    (found,) = (row for row in NUMBERS["predictions"] if row["split"] == split)
    parameter = found["parameters"][name]
    assert f"{parameter['value']:.{digits}f} ± {parameter['half_width']:.{digits}f}" in PAGE


def test_sources_stand_on_the_page_with_their_commits():
    for source in NUMBERS["sources"].values():
        assert f"{source['repository']}, {source['commit'][:7]}" in PAGE


def test_the_resistance_stands_on_the_page():
    found = NUMBERS["resistance"]
    assert f"{found['fitted']:.4f} ± {found['half_width']:.4f} ohm" in PAGE
    assert f"torque gives {found['torque_constant_of_torque_alone']:.4f} N m/A" in PAGE
    assert f"power {found['torque_constant_with_power']:.4f}." in PAGE

"""The pages tell of the first-edition policies what results/robustness holds."""

import json
from pathlib import Path

import pytest

from sprintlab.evaluation.audit import AuditThresholds
from sprintlab.evaluation.report_text import audit_limit, audit_value, number
from sprintlab.evaluation.results import AuditItem
from sprintlab.evaluation.robustness import CAUSES, wilson_interval

ROOT = Path(__file__).resolve().parents[2]
POLICIES = json.loads((ROOT / "results" / "robustness" / "first-edition.json").read_text())["policies"]


def cell(value, digits=2):
    return "-" if value is None else number(value, digits)


def way(row, paced):
    """Time over 100 m, with its mark."""
    suffix = "_self_paced" if paced else ""
    time = row[f"time_100m{suffix}_s"]
    if time is None:
        return "not finished"
    return number(time) + (", left its lane" if row[f"left_lane{suffix}"] else "")


def end(row, paced):
    """How the profile with the 10 s hold ended."""
    suffix = "_self_paced" if paced else ""
    if row[f"fell{suffix}"]:
        return f"fell ({row[f'fell{suffix}']})"
    held = cell(row[f"held_speed{suffix}_m_s"])
    return held if row[f"stopped{suffix}"] else f"{held}, did not stop"


def upright(row):
    found = row["robustness"]
    lower, upper = (100 * bound for bound in found["interval_95"])
    return f"{found['upright']} of {found['trials']} ({lower:.0f} to {upper:.0f} %)"


def held(row):
    quantiles = row["robustness"]["held_speed_quantiles_m_s"]
    return " / ".join(cell(quantiles[name], 1) for name in ("0.05", "0.5", "0.95"))


def audit_cell(item):
    text = audit_value(float("nan") if item["value"] is None else item["value"], item["unit"])
    return text if item["passed"] else f"**{text}**"


def rows():
    """Every line of the table, as the page has it."""
    columns = list(POLICIES.values())
    for label, text in (
        ("command [m/s]", lambda row: f"{row['command_m_s']:g}"),
        ("100 m, raw [s]", lambda row: way(row, False)),
        ("100 m, self-paced [s]", lambda row: way(row, True)),
        ("held after 10 s, raw [m/s]", lambda row: end(row, False)),
        ("  still rising by [m/s²]", lambda row: cell(row["hold_acceleration_m_s2"])),
        ("held after 10 s, self-paced [m/s]", lambda row: end(row, True)),
        ("stride frequency [Hz]", lambda row: cell(row["stride_frequency_Hz"], 1)),
        ("duty factor", lambda row: cell(row["duty"], 3)),
        ("cost of transport", lambda row: cell(row["cost_of_transport"])),
        ("upright, everything randomized", upright),
        ("  held, 5 / 50 / 95 % [m/s]", held),
    ):
        yield f"| {label.strip()} | " + " | ".join(text(row) for row in columns) + " |"
    for items in zip(*(row["audit"] for row in columns), strict=True):
        limit = audit_limit(AuditItem(**items[0], note=""))
        yield f"| {items[0]['name']}: {limit} | " + " | ".join(audit_cell(item) for item in items) + " |"


@pytest.mark.parametrize("line", list(rows()))
def test_the_table_of_the_present_policies_is_the_committed_one(line):
    assert line in (ROOT / "docs" / "results.md").read_text(encoding="utf-8").splitlines()


@pytest.mark.parametrize("name", POLICIES)
def test_shares_follow_from_the_sprints(name):
    found = POLICIES[name]["robustness"]
    together = [sprint for sprint in POLICIES[name]["sprints"] if sprint["group"] == "all"]
    assert found["trials"] == len(together) and found["upright"] == sum(
        sprint["upright"] for sprint in together
    )
    assert tuple(found["interval_95"]) == pytest.approx(wilson_interval(found["upright"], found["trials"]))


@pytest.mark.parametrize("name", POLICIES)
def test_the_robustness_page_says_how_many_stayed_upright(name):
    assert f"| {name} | {upright(POLICIES[name])} | {held(POLICIES[name])} |" in (
        ROOT / "docs" / "robustness.md"
    ).read_text(encoding="utf-8")


def test_the_page_names_every_cause(flowing):
    page = flowing("docs/robustness.md")
    for word in (
        "friction",
        "payload",
        "centre of mass",
        "strength",
        "bus voltage",
        "delay",
        "noise",
        "pads",
    ):
        assert word in page
    assert len(CAUSES) == 10


def test_the_evaluation_page_has_the_limits_of_the_audit(flowing):
    page, limits = flowing("docs/evaluation.md"), AuditThresholds()
    assert f"at most {limits.touchdowns_per_stride:g}" in page
    assert f"at most {limits.foot_force:g} body weights" in page
    assert f"at most {limits.gear_torque_ratio:g} x peak joint torque" in page
    assert f"at most {limits.joint_speed_ratio:g} x no-load" in page
    assert f"at most {limits.winding_temperature:g} °C" in page
    assert f"at most {1e3 * limits.pad_deflection:g} mm" in page
    assert f"at most {limits.lane_half_width:g} m" in page
    assert f"at most {limits.rest_speed:g} m/s" in page

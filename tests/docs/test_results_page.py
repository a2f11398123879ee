"""The pages tell of the policies what results/robustness holds."""

import json
import re
from pathlib import Path

import pytest

from sprintlab.evaluation.audit import AuditThresholds
from sprintlab.evaluation.robustness import CAUSES, wilson_interval

ROOT = Path(__file__).resolve().parents[2]
POLICIES = json.loads((ROOT / "results" / "robustness" / "first-edition.json").read_text())["policies"]


@pytest.fixture(scope="module")
def result_tables(load_script):
    return load_script("tools/result_tables.py")


def test_the_results_page_draws_every_policy_from_the_committed_numbers(result_tables):
    tables = result_tables.tables()
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    assert set(re.findall(r"{{ (\w+) }}", page)) == set(tables)
    summary, audit = tables["policy_summary"].splitlines(), tables["policy_audit"].splitlines()
    for row, (name, policy) in zip(summary[2:], POLICIES.items(), strict=True):
        found = policy["robustness"]
        assert f"`{name}`" in row and f"{policy['held_speed_m_s']:.2f} m/s" in row
        assert f"{found['upright']} of {found['trials']}" in row
        failed = [item for item in policy["audit"] if not item["passed"]]
        assert f"**{len(failed)} of {len(policy['audit'])} lines fail**" in row or not failed
    for number, item in enumerate(
        POLICIES["sprint"]["audit"], start=len(audit) - len(POLICIES["sprint"]["audit"])
    ):
        cells = audit[number].split("|")
        assert cells[1].strip().startswith(item["name"]) and ("**" in cells[2]) != item["passed"]


def test_what_the_page_says_of_the_later_trainings_is_in_them(flowing):
    found = json.loads((ROOT / "results/second-looks/trainings.json").read_text(encoding="utf-8"))
    page, policies = flowing("docs/results.md"), found["policies"]
    runner, audited = (
        found["penalty_factors"]["policies"][name]
        for name in (
            "runner, its weights",
            "runner, stance 26 ms, stride 0.183 s, foot force 3.4 body weights, electrical power 0.6",
        )
    )
    slow, fast = runner["8.0"]["factor"], runner["12.0"]["factor"]
    assert f"by {slow:.2f} at a command of 8 m/s, by {fast:.2f} at 12" in page
    assert f"it is {audited['8.0']['factor']:.2f} and {audited['12.0']['factor']:.2f}" in page
    assert list(runner["12.0"]["gain_without"])[:2] == ["electrical_power", "short_stances"]
    asked = found["asked_to_stand"]
    assert f"{100 * asked['heading_held']:.1f} % of the steps" in page
    assert f"speed: {100 * asked['heading_free']:.1f} %" in page
    for name, row in policies.items():
        met = [t for t in row["trials"] if t["self_paced"] or t["command_m_s"] <= 8.0]
        assert name == "E0" or max(abs(trial["estimate_bias_m_s"]) for trial in met) < 0.2
        left = min(abs(trial["speed_after_1_to_6_s_m_s"][-1]) for trial in row["trials"])
        assert (left > 2.0) == (name in ("A0", "A1", "B0", "C0")), "none of these ever stops"


@pytest.mark.parametrize("name", POLICIES)
def test_shares_follow_from_the_sprints(name):
    found = POLICIES[name]["robustness"]
    together = [sprint for sprint in POLICIES[name]["sprints"] if sprint["group"] == "all"]
    assert found["trials"] == len(together) and found["upright"] == sum(
        sprint["upright"] for sprint in together
    )
    assert tuple(found["interval_95"]) == pytest.approx(wilson_interval(found["upright"], found["trials"]))


def test_the_page_names_every_cause(flowing):
    page = flowing("docs/evaluation.md")
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

"""The study's page, plan and variants: what is trained is told with numbers, what is not by name."""

from __future__ import annotations

import json
import os
import shlex
import time
from dataclasses import fields
from pathlib import Path

import msgspec
import pytest
from studies.paper.answers import verdict
from studies.paper.own_motor import OwnMotorRecord, own_motor
from studies.paper.page import Page, page_text
from studies.paper.plan import PAPER_PRESET, RESULTS, Plan, Training, study_trainings
from studies.paper.record import (
    AuditRecord,
    EvaluationRecord,
    SearchRecord,
    SpeedRecord,
    write_evaluation,
)
from studies.paper.runs import Run, find_runs
from studies.paper.statistics import Interval
from studies.paper.table import DETAIL_COLUMNS, detail_cells, method_rows, switches
from studies.paper.variants import (
    VARIANTS,
    VariantRecord,
    Variants,
    evaluate_variant,
    moved_policy,
    variant_speeds,
)
from tests.short_trials import COARSE

from sprintlab.control import load_policy
from sprintlab.control.contract import check_contract
from sprintlab.core.errors import SprintlabError
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.results import EstimateBand
from sprintlab.robots import load_robot, robot_fingerprint


def search(held: float) -> SearchRecord:
    speed = SpeedRecord(
        top_speed=held,
        trials=10,
        falls=1,
        passed=True,
        held_speed=held,
        peak_speed=held,
        angular_cost=1.0,
        lateral_deviation=0.0,
        cost_of_transport=1.0,
        electrical_power=1.0,
        stride_frequency=3.0,
        duty_factor=(),
        envelope_share=(0.0, 0.2, 0.5) * 4,
        audit=AuditRecord(items=()),
    )
    return SearchRecord(speeds=(speed,))


def record(method: str, seed: int, held: float) -> EvaluationRecord:
    return EvaluationRecord(
        method=method,
        seed=seed,
        actuator_model="refined",
        training={},
        policy_sha256="",
        robot="bp2",
        robot_fingerprint="",
        protocol={},
        command_line="",
        date="",
        versions={},
        machine="",
        raw=search(held),
        self_paced=search(held),
        sprint=None,
        sprint_self_paced=None,
    )


ITEM = {"name": "stance", "value": 1.0, "unit": "s", "threshold": 1.0, "passed": True}
BAND = dict.fromkeys((field.name for field in fields(EstimateBand)), 0.0) | {"samples": 0}
SPEEDS = {
    "sprint": (12.0, 12.2, 12.4, 12.3, 12.1),
    "simplified-dc": (11.0, 11.1, 11.2, 11.3, 11.4),
    "uniform-commands": (12.1, 12.2, 12.3, 12.2, 1.0),
    "fixed-acceleration": (1.0, 1.1, 13.0),
    "rlvrl": (9.0, 9.5, 10.0),
    "after-hacl": (8.0, 8.5, 8.2),
}


@pytest.fixture
def results(tmp_path):
    folder = tmp_path / "results"
    for method, speeds in SPEEDS.items():
        for seed, held in enumerate(speeds):
            write_evaluation(folder / method / f"seed-{seed}" / "evaluation.json", record(method, seed, held))
    write_evaluation(
        folder / "paper" / "fixed-acceleration" / "seed-0" / "evaluation.json",
        record("fixed-acceleration", 0, 1.5),
    )
    for method, held in (("sprint", 11.25), ("simplified-dc", 10.75)):
        found = VariantRecord(
            variant="bp2-weak", policy_sha256="", robot_fingerprint="", protocol={}, date="", versions={},
            raw=search(held),
        )  # fmt: skip
        (folder / method / "seed-1" / "bp2-weak.json").write_bytes(msgspec.json.encode(found))
    return folder


def test_the_papers_reward_answers_beside_ours_as_soon_as_it_is_trained(results) -> None:
    before = page_text(results)
    assert before.count("With the paper's reward to the letter it is not evaluated yet.") == 2
    for method, held in (("sprint", 11.5), ("simplified-dc", 9.2)):
        folder = results / "paper" / method / "seed-0"
        write_evaluation(folder / "evaluation.json", record(method, 0, held))
    after = page_text(results)
    letter = "With the paper's reward to the letter"
    assert f"{letter} `sprint` holds 11.50 m/s, `simplified-dc` 9.20: +25.0 %" in after
    assert after.count(f"{letter} it is not evaluated yet.") == 1


def test_the_page_answers_what_it_can_and_names_what_is_missing(results) -> None:
    text = page_text(results, ["![learning](figures/learning.png)"], ["![estimate](figures/estimate.png)"])
    first = text.split("\n\n")[2]
    assert "**Confirmed**: faster than `simplified-dc`" in first and "**Open**: faster than" in first
    assert "`fixed-acceleration` (so far faster in 67 % of the pairs of seeds)" in first
    assert "`sprint` holds 12.20" in text and "+8.9 %" in text
    assert "1.00 [1.00, 1.00]: settled" in text
    assert "trained on the nominal robot, hold 11.25 and 10.75 m/s" in text
    assert "Not evaluated yet on the strong edition" in text
    assert "Not evaluated yet: `no-saturation`" in text
    assert "`uniform-commands`: 1 of 5 seeds collapsed" in text
    assert "With our reward 2 of 3 seeds collapse; the others hold 13.00 m/s." in text
    assert "to the letter 1 of 1 seeds collapse." in text
    assert "`rlvrl` is the fastest of 2" in text and "`lp-acrl`" in text
    assert "| rlvrl | refined | box-adaptive grid |" in text
    assert "![learning](figures/learning.png)" in text.split("??? info")[0] and "![estimate]" in text
    assert "| Hound | 6.5 | 5.9 | reported |" in text
    assert "| baseline |" not in text and "`baseline`" in text


def test_a_page_of_nothing_says_so(tmp_path) -> None:
    text = page_text(tmp_path)
    assert text.count("Not evaluated yet") >= 5 and "## Methods" not in text


def test_a_page_is_not_written_over_where_the_results_are_no_folder(tmp_path) -> None:
    (tmp_path / "study.md").write_text("written before")
    with pytest.raises(SprintlabError, match="there is no folder"):
        Page(results=tmp_path / "gone", out=tmp_path / "study.md").run()
    assert (tmp_path / "study.md").read_text() == "written before"


def test_the_plan_shows_a_path_without_control_characters(tmp_path, capsys) -> None:
    assert Plan(runs=tmp_path / "\x1b[31mred", results=tmp_path).run() == 0
    shown = capsys.readouterr().out
    assert "\x1b" not in shown and "\\x1b[31mred/sprint/seed-0" in shown


def test_an_order_is_settled_where_its_interval_leaves_out_one_half() -> None:
    assert verdict(Interval(center=0.9, low=0.6, high=1.0), 3) == "settled"
    assert verdict(Interval(center=0.1, low=0.0, high=0.4), 5) == "settled"
    assert verdict(Interval(center=0.7, low=0.4, high=0.9), 5) == "open"
    assert verdict(Interval(center=1.0, low=1.0, high=1.0), 2) == "open, with 2 seeds"
    assert verdict(Interval(center=0.9), 1) == "open, with 1 seed"


def test_a_policy_that_slows_down_when_asked_for_too_much_has_not_collapsed() -> None:
    (slow,), (fast,) = search(1.0).speeds, search(8.0).speeds
    found = SearchRecord(speeds=(fast, msgspec.structs.replace(slow, top_speed=16.0)))
    assert (found.max_velocity, found.most_held, found.collapsed) == (1.0, 8.0, False)
    (row,) = method_rows({"sprint": [msgspec.structs.replace(record("sprint", 0, 1.0), raw=found)]})
    assert (row.most_held.center, row.max_velocity.center, row.collapsed) == (8.0, 1.0, 0)


def test_hips_and_knees_on_their_limit_are_told_apart() -> None:
    (row,) = method_rows({"sprint": [record("sprint", 0, 12.0)]})
    cells = dict(zip(DETAIL_COLUMNS, detail_cells(row), strict=True))
    assert (cells["hip on its limit"], cells["knee on its limit"]) == ("0.20", "0.50")


def test_methods_are_told_by_their_switches() -> None:
    assert switches("hound") == ("v_d = 0", "uniform, ramp of 1 s")
    assert switches("spot-battery") == ("refined + battery", "adaptive")
    assert switches("actuator-network")[0] == "network" and switches("literal-acs")[1] == "adaptive, literal"
    assert switches("no-saturation")[0] == "refined, no saturation" and switches("mine") == ("-", "-")


def test_the_plan_lists_what_is_missing_as_commands_that_train_it(call, results, tmp_path) -> None:
    everything = study_trainings()
    assert len(set(everything)) == len(everything) == 6 * 5 + 9 * 3 + 7 * 3
    outcome = call("plan", tmp_path / "runs", "--results", results, "--json")
    missing = json.loads(outcome.out)["missing"]
    finished = sum(map(len, SPEEDS.values())) + 1
    assert len(missing) == len(everything) - finished
    assert not any("train sprint" in line and "--preset" not in line for line in missing)


@pytest.mark.parametrize("method", ["actuator-network", "stride-prior", "literal-acs"])
def test_a_line_of_the_plan_is_what_the_trainer_reads(method, tmp_path) -> None:
    pytest.importorskip("mujoco_warp")
    from sprintlab.cli.train import parse_training

    preset = "paper" if method == "literal-acs" else "sprintlab"
    words = shlex.split(shlex.join(Training(method=method, seed=2, preset=preset).words(tmp_path)))
    options = parse_training(words[2:])
    settings = options.full_settings()
    assert (settings.method, settings.seed, options.preset) == (method, 2, preset)
    assert settings.ppo.precision == "bfloat16"
    assert (settings.simulation.actuator_network is None) == (method != "actuator-network")
    assert (settings.prior is None) == (method != "stride-prior")


def test_a_policy_moves_to_an_edition_of_its_robot_and_to_no_other(policy, tmp_path) -> None:
    weak = load_robot("bp2-weak")
    contract = load_policy(moved_policy(policy, weak, tmp_path)).contract
    check_contract(contract, weak)
    assert contract.training == load_policy(policy).contract.training
    with pytest.raises(SprintlabError, match="no policy of an edition of go1"):
        moved_policy(policy, load_robot("go1"), tmp_path)


@pytest.mark.parametrize("name", ["bp2-weak", "flux-weakening"])
def test_a_variant_is_evaluated_with_its_robot_and_drive(name, policy) -> None:
    settings = ProtocolSettings(trials=1, required=1, start=0.5, top=0.5, hold=0.5, plant=COARSE)
    found = evaluate_variant(policy, name, settings, workers=1)
    assert found.variant == name and len(found.raw.speeds) == 1 and found.raw.speeds[0].trials == 1
    assert found.protocol["plant"]["motor_model"] == VARIANTS[name].motor_model
    assert found.robot_fingerprint == robot_fingerprint(load_robot(VARIANTS[name].robot))


def _forged(found, *path_and_value):
    *path, last, value = path_and_value
    for name in path:
        found = found[name]
    found[last] = value


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("training", "environment_steps", "many"), "environment_steps is no whole number"),
        (("method", "<script>alert(1)</script>"), "method"),
        (("method", "a\x1b[2J"), "method"),
        (("seed", -1), "seed"),
        (("raw", "speeds", 0, "held_speed", 1.7e308), "beyond 1e"),
        (("raw", "speeds", 0, "audit", "items", [dict(ITEM, name="<img src=x>")]), "name"),
        (("raw", "speeds", 0, "estimate", [BAND]), "no samples"),
        (("clock", {"top_speed": 1.0, "entries": [], "followed": None}), "entries"),
        (("machine", "x" * (5 << 20)), "larger than 4 MB"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_a_strangers_evaluation_puts_nothing_on_the_page(tmp_path, change, said):
    place = tmp_path / "sprint" / "seed-0" / "evaluation.json"
    write_evaluation(place, record("sprint", 0, 12.0))
    content = json.loads(place.read_bytes())
    _forged(content, *change)
    place.write_text(json.dumps(content))
    with pytest.raises(SprintlabError, match=said):
        page_text(tmp_path)


def test_a_folder_whose_name_is_markup_is_refused(tmp_path):
    write_evaluation(tmp_path / "<b>" / "seed-0" / "evaluation.json", record("sprint", 0, 12.0))
    with pytest.raises(SprintlabError, match="a method's name"):
        page_text(tmp_path)


def test_a_pipe_in_place_of_a_variant_is_not_waited_for(tmp_path):
    write_evaluation(tmp_path / "sprint" / "seed-0" / "evaluation.json", record("sprint", 0, 12.0))
    os.mkfifo(tmp_path / "sprint" / "seed-0" / "drake.json")
    assert "sprint" in page_text(tmp_path)


@pytest.mark.usefixtures("brief_trials")
def test_a_policy_runs_with_the_motor_of_its_training_and_with_the_real_one(tmp_path) -> None:
    place = tmp_path / "no-envelope" / "seed-0"
    place.mkdir(parents=True)
    (place / "policy.onnx").write_bytes(_kept("no-envelope").read_bytes())
    write_evaluation(place / "evaluation.json", record("no-envelope", 0, 2.0))
    run = Run(method="no-envelope", seed=0, folder=place)
    found = own_motor(run, load_robot("bp2"))
    assert found is not None and (found.motor_model, found.top_speed) == ("square", 2.0)
    assert set(found.impossible) == {"hind hips", "hind knees"}
    assert all(0.0 <= share < 0.5 for share in found.impossible.values())
    kept = Run(method="sprint", seed=1, folder=_kept("sprint").parent)
    assert own_motor(kept, load_robot("bp2")) is None


def _kept(method: str) -> Path:
    """The one policy of a method among the committed results."""
    (policy,) = RESULTS.glob(f"{method}/seed-*/policy.onnx")
    return policy


def test_the_page_tells_what_a_policy_asks_of_a_motor_that_it_never_had(results) -> None:
    found = OwnMotorRecord(
        motor_model="simplified-dc", policy_sha256="", date="", top_speed=11.0, held_speed_own=11.2,
        held_speed_refined=11.1, impossible={"hind hips": 0.0, "hind knees": 0.0155},
    )  # fmt: skip
    path = results / "simplified-dc" / "seed-2" / "own-motor.json"
    path.write_bytes(msgspec.json.encode(found))
    text = page_text(results)
    assert (
        "`simplified-dc` asks for it 1.6 % of the time" in text
        and "| 11.20 | 11.10 | 0.0 % | 1.6 % |" in text
    )
    path.write_bytes(msgspec.json.encode(found).replace(b"hind hips", b"<script>"))
    assert "asks for it" not in page_text(results)


def test_own_motors_that_tell_of_different_joints_stand_on_one_page(results) -> None:
    for method, joint in (("simplified-dc", "hind hips"), ("sprint", "tails")):
        found = OwnMotorRecord(
            motor_model="square", policy_sha256="", date="", top_speed=11.0, held_speed_own=11.2,
            held_speed_refined=11.1, impossible={joint: 0.25},
        )  # fmt: skip
        folder = results / method / "seed-1"
        (folder / "own-motor.json").write_bytes(msgspec.json.encode(found))
    text = page_text(results)
    assert "| 11.20 | 11.10 | 25.0 % | - |" in text and "| 11.20 | 11.10 | - | 25.0 % |" in text


@pytest.mark.parametrize("shares", [{}, {f"joint {number}": 0.5 for number in range(21)}], ids=len)
def test_an_own_motor_of_no_joints_or_of_a_crowd_counts_as_none(results, shares) -> None:
    """The largest share of none ended the page in a traceback; each joint is a column of its table."""
    found = OwnMotorRecord(
        motor_model="square", policy_sha256="", date="", top_speed=11.0, held_speed_own=11.2,
        held_speed_refined=11.1, impossible=shares,
    )  # fmt: skip
    (results / "sprint" / "seed-1" / "own-motor.json").write_bytes(msgspec.json.encode(found))
    assert "asks for it" not in page_text(results)


def test_a_search_of_thousands_of_speeds_is_read_in_time() -> None:
    """So many stand in a file of 4 MB; the fastest is asked for twenty times for one page."""
    (speed,) = search(12.0).speeds
    many = SearchRecord(speeds=(speed,) * 16_000)
    started = time.process_time()
    assert many.fastest is speed and many.most_held == 12.0
    assert time.process_time() - started < 2.0  # with the square of their number: 10 s


def test_a_variant_under_the_name_of_another_is_not_taken_for_it(results, monkeypatch, capsys) -> None:
    """One that is unknown ended the command in a traceback."""
    weak = results / "sprint" / "seed-1" / "bp2-weak.json"
    for variant in (b"bp2-strong", b"unknown"):
        weak.write_bytes(weak.read_bytes().replace(b'"bp2-weak"', b'"%s"' % variant))
        assert variant_speeds(find_runs(results)) == {"simplified-dc": {"bp2-weak": 10.75}}
    (weak.parent / "policy.onnx").write_bytes(b"")
    again = json.loads(weak.read_bytes()) | {"variant": "bp2-weak"}
    monkeypatch.setattr(
        "studies.paper.variants.evaluate_variant", lambda *_: msgspec.convert(again, VariantRecord)
    )
    assert Variants(results=results, only=("bp2-weak",), workers=1).run() == 0
    assert variant_speeds(find_runs(results))["sprint"] == {"bp2-weak": 11.25}


def test_the_committed_runs_are_what_the_plan_trains() -> None:
    """Seeds that come later must share every setting with those that are there."""
    pytest.importorskip("mujoco_warp")
    from sprintlab.cli.train import parse_training

    for run in find_runs(RESULTS):
        words = Training(method=run.method, seed=run.seed).words(run.folder)
        digest = parse_training(words[2:]).full_settings().digest()
        assert digest in (run.folder / "run.toml").read_text(encoding="utf-8"), run


def test_every_policy_that_is_committed_can_be_read():
    for folder in (RESULTS, RESULTS / PAPER_PRESET):
        runs = find_runs(folder)
        kept = [run for run in runs if run.policy.is_file()]
        assert sorted(run.method for run in kept) == sorted({run.method for run in runs})
        for run in kept:
            assert load_policy(run.policy).contract.robot_name == "bp2", run

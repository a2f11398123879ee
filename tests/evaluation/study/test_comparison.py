"""The methods side by side: searches that resume, tables, pages, folders of runs."""

import dataclasses
import json
import math
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from studies.paper import measure, runs
from studies.paper.measure import Candidate, EvaluationPlan, evaluate_candidates
from studies.paper.pages import (
    markdown_table,
    replace_section,
    result_tables,
    section_marks,
    update_results_page,
)
from studies.paper.paper import PAPER_TABLE
from studies.paper.record import (
    AuditEntry,
    AuditRecord,
    ClockEntry,
    ClockRecord,
    EvaluationRecord,
    SearchRecord,
    SpeedRecord,
    SprintRecord,
    encode,
    read_evaluation,
    speed_record,
    write_evaluation,
)
from studies.paper.table import (
    CLOCK_COLUMNS,
    SEED_COLUMNS,
    TABLE_COLUMNS,
    clock_cells,
    common_speed,
    method_rows,
    order_text,
    seed_cells,
    table_cells,
    table_numbers,
)
from tests.short_trials import COARSE

import sprintlab
from sprintlab.core.errors import InvalidValueError, PolicyFileError, SimulationError, SprintlabError
from sprintlab.evaluation.audit import CLOCK_ITEM
from sprintlab.evaluation.protocol import ProtocolSettings, search_speeds
from sprintlab.evaluation.results import EstimateBand, SpeedResult

SHORT = ProtocolSettings(trials=1, required=1, start=0.5, top=0.75, hold=0.5, plant=COARSE)


def speed(top_speed, passed=True, cost=2.0, held=None, **values):
    return SpeedRecord(
        **{
            "top_speed": top_speed,
            "trials": 10,
            "falls": 0 if passed else 2,
            "passed": passed,
            "held_speed": top_speed - 0.5 if held is None else held,
            "peak_speed": top_speed,
            "angular_cost": cost,
            "lateral_deviation": 0.1,
            "cost_of_transport": 1.0,
            "electrical_power": 1000.0,
            "stride_frequency": 3.0,
            "duty_factor": (0.2,) * 4,
            "envelope_share": (0.1,) * 12,
            "audit": AuditRecord(items=()),
            **values,
        }
    )


def record(method="sprint", seed=0, best=10.0, cost=2.0, **values):
    """An evaluation that passed whole speeds up to ``best`` and failed the next."""
    steps = [speed(float(top), cost=cost * top / best) for top in range(1, int(best) + 1)]
    search = SearchRecord(speeds=(*steps, speed(best + 1.0, passed=False)))
    sprint = SprintRecord(
        top_speed=best, distance=100.0, time=100.0 / best, fell=False, audit=AuditRecord(items=())
    )
    fields = {
        "method": method,
        "seed": seed,
        "actuator_model": "refined",
        "training": {"environment_steps": "1000000"},
        "policy_sha256": "0" * 64,
        "robot": "bp2",
        "robot_fingerprint": "f",
        "protocol": {},
        "command_line": "sprintlab ablate",
        "date": "2026-01-01",
        "versions": {},
        "machine": "none",
        "raw": search,
        "self_paced": search,
        "sprint": sprint,
        "sprint_self_paced": sprint,
    }
    return EvaluationRecord(**{**fields, **values})


@dataclasses.dataclass
class Try:
    speed: float
    passed: bool


@pytest.mark.parametrize("limit", [0.5, 1.0, 3.0, 3.25, 3.75, 15.75, 99.0])
def test_two_passes_find_what_one_finds(limit):
    tried = {}

    def run(top_speed):
        return Try(top_speed, top_speed <= limit)

    for name, step in (("whole grid", None), ("two passes", 1.0)):
        result = search_speeds(ProtocolSettings(first_step=step), run)
        assert [one.speed for one in result] == sorted(one.speed for one in result)
        tried[name] = (max((one.speed for one in result if one.passed), default=None), len(result))
    assert tried["whole grid"][0] == tried["two passes"][0]
    if limit > 3.0:
        assert tried["two passes"][1] < tried["whole grid"][1]


def test_a_first_pass_off_the_grid_is_refused():
    with pytest.raises(InvalidValueError, match="first_step"):
        ProtocolSettings(first_step=0.6)


def test_best_is_the_speed_before_the_first_that_failed():
    search = SearchRecord(speeds=(speed(1.0), speed(2.0), speed(2.25, passed=False), speed(3.0)))
    assert search.best is not None and search.best.top_speed == 2.0
    assert search.at(2.25) is not None and search.at(2.5) is None
    nothing = SearchRecord(speeds=(speed(1.0, passed=False),))
    assert nothing.best is None and math.isnan(nothing.max_velocity) and not nothing.audit_passed


def test_only_completed_trials_make_the_numbers(make_trial):
    trials = (make_trial(held_speed=9.0), make_trial(held_speed=1.0, completed=False))
    result = speed_record(SpeedResult(top_speed=9.5, self_paced=False, trials=trials, required=1))
    assert (result.held_speed, result.falls, result.passed) == (9.0, 1, True)
    fallen = speed_record(SpeedResult(top_speed=9.5, self_paced=False, trials=trials[1:], required=1))
    assert fallen.held_speed is None and fallen.duty_factor == () and not fallen.passed
    json.dumps(encode(fallen), allow_nan=False)


@pytest.fixture(scope="module")
def plan(robot, tmp_path_factory):
    cache = tmp_path_factory.mktemp("cache")
    return EvaluationPlan(robot=robot, protocol=SHORT, distance=1.0, cache=cache, workers=1)


@pytest.fixture(scope="module")
def standing(standing_policy, plan):
    """The evaluation of a policy that stands, computed once."""
    candidate = Candidate(method="sprint", seed=3, policy=standing_policy)
    return candidate, evaluate_candidates([candidate], plan)[0]


def test_an_evaluation_runs_both_searches_and_survives_the_disk(standing, tmp_path):
    _, result = standing
    for search in (result.raw, result.self_paced):
        assert [one.top_speed for one in search.speeds] == [0.5, 0.75]
        assert search.best is not None and search.best.falls == 0
    assert result.sprint is None and result.raw.collapsed  # it stands
    write_evaluation(tmp_path / "evaluation.json", result)
    assert read_evaluation(tmp_path / "evaluation.json") == result


def test_what_is_done_is_not_done_again(standing, plan, monkeypatch):
    candidate, result = standing
    monkeypatch.setattr(measure, "run_speed", lambda *_, **__: pytest.fail("a speed was run again"))
    (again,) = evaluate_candidates([candidate], plan)
    assert (again.raw, again.self_paced, again.sprint) == (result.raw, result.self_paced, result.sprint)


def test_a_killed_evaluation_goes_on_and_a_damaged_file_counts_for_nothing(standing, plan, monkeypatch):
    candidate, result = standing
    files = sorted(plan.cache.glob("*/raw-*.json"))
    before = files[0].stat().st_mtime_ns
    files[1].write_text(files[1].read_text()[:40])
    (again,) = evaluate_candidates([candidate], plan)
    assert again.raw == result.raw
    assert json.loads(files[1].read_text())["top_speed"] == 0.75 and files[0].stat().st_mtime_ns == before


def test_other_settings_and_policies_have_other_places_in_the_cache(plan):
    other = dataclasses.replace(plan, protocol=dataclasses.replace(SHORT, trials=2))
    further = dataclasses.replace(plan, protocol=dataclasses.replace(SHORT, top=9.0))
    assert plan.digest("a") != plan.digest("b") and plan.digest("a") != other.digest("a")
    assert plan.digest("a") == further.digest("a")


def test_a_policy_that_is_none_is_refused_before_anything_runs(standing, plan, tmp_path, monkeypatch):
    monkeypatch.setattr(measure, "run_speed", lambda *_, **__: pytest.fail("something ran"))
    bad = Candidate(method="baseline", seed=0, policy=tmp_path / "none.onnx")
    with pytest.raises(PolicyFileError, match=r"none\.onnx"):
        evaluate_candidates([standing[0], bad], plan)


def test_a_failure_in_one_policy_arrives(standing, plan, monkeypatch, make_policy):
    def fail(*_, **__):
        raise SprintlabError("the disk is full")

    monkeypatch.setattr(measure, "run_speed", fail)
    plan = dataclasses.replace(plan, cache=None)
    with pytest.raises(SprintlabError, match="the disk is full"):
        evaluate_candidates([standing[0], standing[0]], plan)


def test_a_policy_that_fails_leaves_the_others_their_time(standing, plan, monkeypatch, make_policy):
    bad = Candidate(method="gallop", seed=1, policy=make_policy(np.full(12, 0.01)))
    real, done = measure.run_speed, []

    def run_speed(pool, *arguments, **more):
        if np.any(pool.policy.infer(np.zeros((1, pool.policy.layout.input_size), np.float32))):
            raise SimulationError("no longer finite")
        return real(pool, *arguments, **more)

    monkeypatch.setattr(measure, "run_speed", run_speed)
    with pytest.raises(SprintlabError, match=r"1 of 2 policies .* gallop, seed 1: no longer finite"):
        evaluate_candidates([bad, standing[0]], plan, done=lambda candidate, _: done.append(candidate))
    assert done == [standing[0]]


def test_table_two_stands_beside_the_papers():
    records = {method: [record(method, seed, cost=1.0 + seed) for seed in range(3)] for method in PAPER_TABLE}
    rows = {row.method: row for row in method_rows(records)}
    assert list(rows) == list(PAPER_TABLE)
    cells = dict(zip(TABLE_COLUMNS, table_cells(rows["sprint"]), strict=True))
    assert cells["paper: speed"] == "12.4" and cells["paper: J_norm"] == "1.000"
    assert cells["ours: most held"] == "9.50 [9.50, 9.50]" and cells["ours: J_norm"].startswith("1.000 [0.")
    assert cells["sprint faster"] == "-"
    assert cells["100 m"] == "10.00 [10.00, 10.00]" and cells["audit"] == "3 of 3"
    collapse = dict(zip(TABLE_COLUMNS, table_cells(rows["fixed-acceleration"]), strict=True))
    assert collapse["paper: speed"] == "collapse" and collapse["ours: most held"] == "9.50 [9.50, 9.50]"
    assert collapse["sprint faster"] == "0.50 [0.50, 0.50]"


def test_collapsed_seeds_are_told_and_do_not_drag_the_others():
    stands = SearchRecord(speeds=(speed(1.0, held=0.1), speed(16.0, held=0.0)))
    records = {"sprint": [record(seed=0), record(seed=1, raw=stands, self_paced=stands)]}
    (row,) = method_rows(records)
    assert row.collapsed == 1 and row.max_velocity.center == 9.5
    assert "(1 of 2 collapsed)" in table_cells(row)[4]
    (row,) = method_rows({"sprint": records["sprint"][1:]})
    assert table_cells(row)[4] == "collapse"
    assert common_speed(records["sprint"]) == 10.0


def test_the_common_speed_is_one_that_all_passed():
    assert common_speed([record(best=10.0), record(best=7.0), record(best=12.0)]) == 7.0
    assert common_speed([]) is None
    row = method_rows({"sprint": [record(best=10.0, cost=2.0)], "baseline": [record(best=5.0, cost=3.0)]})[0]
    assert row.common_cost.center == pytest.approx(1.0)  # J of sprint at 5 m/s


def test_without_the_reference_j_norm_is_not_defined():
    row = method_rows({"baseline": [record("baseline")], "sprint": []})[0]
    assert (
        math.isnan(row.normalized_cost.center)
        and dict(zip(TABLE_COLUMNS, table_cells(row), strict=True))["ours: J_norm"] == "-"
    )
    json.dumps(table_numbers({"baseline": [record("baseline")]}), allow_nan=False)


def test_the_order_of_the_methods_is_told_beside_the_papers():
    records = {"sprint": [record(best=12.0)], "baseline": [record("baseline", best=9.0)], "no-envelope": []}
    text = order_text(method_rows(records))
    assert "in the paper sprint > simplified-dc > no-envelope = uniform-commands > baseline" in text
    assert text.endswith("ours sprint > baseline.")
    assert order_text(method_rows({"sprint": [record()]})) == ""


def test_a_failed_audit_is_named():
    item = {
        "name": "deepest foot penetration",
        "value": 0.02,
        "unit": "m",
        "threshold": 0.005,
        "passed": False,
    }
    audit = msgspec.convert({"items": [item]}, AuditRecord)
    search = SearchRecord(speeds=(speed(9.0, audit=audit),))
    cells = dict(zip(SEED_COLUMNS, seed_cells(record(raw=search)), strict=True))
    assert cells["audit"] == "deepest foot penetration"


def test_the_most_that_was_held_stands_beside_the_max_velocity():
    search = SearchRecord(speeds=(speed(9.0, held_speed=8.8), speed(10.0, held_speed=7.5)))
    cells = dict(zip(SEED_COLUMNS, seed_cells(record(raw=search)), strict=True))
    assert cells["v* raw"] == "10" and cells["max velocity raw"] == "7.50"
    assert cells["fastest raw"] == "8.80 at 9"
    nothing = SearchRecord(speeds=(speed(9.0, passed=False),))
    cells = dict(zip(SEED_COLUMNS, seed_cells(record(raw=nothing)), strict=True))
    assert cells["v* raw"] == cells["fastest raw"] == "-"


def test_a_fall_behind_the_line_is_named():
    fallen = msgspec.structs.replace(record().sprint, fell=True)
    unfinished = msgspec.structs.replace(fallen, time=None)
    cells = dict(zip(SEED_COLUMNS, seed_cells(record(sprint=fallen)), strict=True))
    assert cells["100 m raw"] == "10.00, fell" and cells["100 m self-paced"] == "10.00"
    assert (
        dict(zip(SEED_COLUMNS, seed_cells(record(sprint=unfinished)), strict=True))["100 m raw"] == "-, fell"
    )


def test_runs_are_found_in_the_papers_order(tmp_path):
    for name in ("sprint/seed-10", "sprint/seed-2", "baseline/seed-0", "gallop/seed-1", "sprint/notes"):
        (tmp_path / name).mkdir(parents=True)
    found = [(run.method, run.seed) for run in runs.find_runs(tmp_path)]
    assert found == [("baseline", 0), ("sprint", 2), ("sprint", 10), ("gallop", 1)]
    with pytest.raises(SprintlabError, match="seed-<number>"):
        runs.find_runs(tmp_path / "sprint")
    with pytest.raises(SprintlabError, match="no folder"):
        runs.find_runs(tmp_path / "nothing")


def test_records_are_grouped_with_every_method_of_the_paper():
    grouped = runs.by_method([record("gallop"), record("sprint", 1), record("sprint", 0)])
    assert list(grouped) == [*PAPER_TABLE, "gallop"]
    assert [one.seed for one in grouped["sprint"]] == [0, 1] and grouped["baseline"] == []


def test_a_damaged_evaluation_is_refused(tmp_path):
    path = tmp_path / "evaluation.json"
    with pytest.raises(SprintlabError, match="cannot read"):
        read_evaluation(path)
    path.write_text('{"format_version": 1, "format_version": 2}')
    with pytest.raises(SprintlabError, match="format_version stands twice"):
        read_evaluation(path)
    path.write_text('{"format_version": 1}')
    with pytest.raises(SprintlabError, match="no record of this version"):
        read_evaluation(path)


@pytest.fixture
def page(tmp_path):
    path = tmp_path / "results.md"
    marks = (section_marks(name) for name in ("methods", "details", "seeds", "clock", "estimates"))
    path.write_text(
        "# Results\n\n" + "\n\nbetween\n\n".join("\n\nold\n\n".join(pair) for pair in marks) + "\n"
    )
    return path


def test_a_page_keeps_its_text_and_gets_new_tables(page):
    band = EstimateBand(
        lower=2.0,
        upper=4.0,
        samples=9,
        forward_bias=0.0,
        forward_error=0.1,
        velocity_error=0.2,
        height_error=0.01,
        contact_accuracy=0.9,
    )
    estimating = SearchRecord(speeds=(speed(9.0, estimate=(band,)),))
    grouped = runs.by_method([record(), record("baseline", raw=estimating)])
    update_results_page(page, grouped)
    text = page.read_text()
    assert text.startswith("# Results") and text.count("between") == 4 and "old" not in text.split()
    assert markdown_table(TABLE_COLUMNS, []).splitlines()[0] in text
    assert "| 2 to 4 | 9 |" in text and "Estimates of baseline" in text
    update_results_page(page, grouped)
    assert page.read_text() == text


def test_every_table_has_as_many_cells_as_columns():
    for table in result_tables(runs.by_method([record()])):
        assert table.rows and all(len(row) == len(table.columns) for row in table.rows)


def test_a_page_without_marks_is_refused(tmp_path):
    path = tmp_path / "page.md"
    path.write_text("nothing here")
    with pytest.raises(SprintlabError, match="computed: methods"):
        replace_section(path, "methods", "x")
    assert path.read_text() == "nothing here"


def test_a_policy_in_the_place_of_another_method_or_seed_is_refused():
    def contract(method, seed):
        return SimpleNamespace(training=SimpleNamespace(method=method, seed=seed))

    candidate = Candidate(method="sprint", seed=1, policy=Path("policy.onnx"))
    measure.check_origin(candidate, contract("sprint", 1))
    measure.check_origin(candidate, contract("of-my-own", 7))
    for other in (contract("baseline", 1), contract("sprint", 2)):
        with pytest.raises(SprintlabError, match="lies in the place of sprint, seed 1"):
            measure.check_origin(candidate, other)


def test_a_record_answers_for_its_policy_and_plan_only(standing, plan):
    candidate, result = standing
    assert measure.answers(result, candidate, plan)
    other = dataclasses.replace(plan, protocol=dataclasses.replace(SHORT, seed=5))
    assert not measure.answers(result, candidate, other)
    assert not measure.answers(result, dataclasses.replace(candidate, seed=9), plan)
    assert not measure.answers(msgspec.structs.replace(result, policy_sha256="0"), candidate, plan)


def test_what_cannot_be_read_counts_as_no_record(tmp_path):
    good, bad = (runs.Run(method="sprint", seed=seed, folder=tmp_path / f"seed-{seed}") for seed in (0, 1))
    write_evaluation(good.evaluation, record())
    bad.folder.mkdir()
    bad.evaluation.write_text("{")
    assert runs.readable_records([good, bad]) == [record()]


def test_the_hundred_metres_are_run_where_most_speed_was_held():
    search = SearchRecord(speeds=(speed(12.0, held=11.8), speed(13.0, held=11.2), speed(14.0, passed=False)))
    assert search.best.top_speed == 13.0 and search.fastest.top_speed == 12.0
    assert SearchRecord(speeds=(speed(1.0, passed=False),)).fastest is None


def test_a_clock_that_costs_nothing_is_told_from_one_that_the_speed_lives_on():
    def clock(*held, completed=10):
        entries = (clock_entry(held[0]), *(clock_entry(speed, completed) for speed in held[1:]))
        return ClockRecord(top_speed=12.0, entries=entries, followed=1.0)

    item = AuditEntry(name=CLOCK_ITEM, value=0.0, unit="policy steps", threshold=0.02, passed=False)
    search = SearchRecord(speeds=(speed(9.0, audit=AuditRecord(items=(item,))),))
    assert not record(raw=search).credible  # nobody has looked
    assert record(raw=search, clock=clock(12.0, 11.7, 12.0, 11.9)).credible
    assert not record(raw=search, clock=clock(12.0, 10.0, 12.0, 11.9)).credible
    assert not record(raw=search, clock=clock(12.0, 11.7, 12.0, 11.9, completed=8)).credible
    other = msgspec.structs.replace(item, name="foot slip per step")
    slips = SearchRecord(speeds=(speed(9.0, audit=AuditRecord(items=(item, other))),))
    assert not record(raw=slips, clock=clock(12.0, 12.0, 12.0, 12.0)).credible
    (row,) = method_rows({"sprint": [record(raw=search, clock=clock(12.0, 11.7, 12.0, 11.9))]})
    assert dict(zip(TABLE_COLUMNS, table_cells(row), strict=True))["audit"] == "0 of 1, 1 but for the clock"


def clock_entry(held, completed=9):
    return ClockEntry(
        rate=50.0,
        jitter=0.0,
        trials=10,
        completed=completed,
        held_speed=held,
        stride_frequency=50 / 7,
        clock_distance=0.0,
    )


def test_the_clock_table_has_a_row_a_policy():
    entry = clock_entry(12.0)
    clock = ClockRecord(top_speed=12.0, entries=(entry,) * 4, followed=1.0)
    cells = dict(zip(CLOCK_COLUMNS, clock_cells(record(clock=clock)), strict=True))
    assert cells["policy steps a stride"] == "7.00" and cells["stride follows the clock [%]"] == "100"
    assert cells["completed"] == "9, 9, 9, 9 of 10"
    assert set(clock_cells(record())[2:]) == {"-"}


@pytest.mark.usefixtures("not_installed")
def test_an_evaluation_knows_its_versions_in_a_source_tree_that_is_not_installed():
    assert measure.versions()["sprintlab"] == sprintlab.__version__

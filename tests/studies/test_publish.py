"""Finished runs are put where they are committed."""

import json
import time
from contextlib import suppress

import pytest
from studies.paper.gallery import read_curve
from studies.paper.publish import Publish, publish
from studies.paper.record import (
    AuditEntry,
    AuditRecord,
    EvaluationRecord,
    SearchRecord,
    SpeedRecord,
    write_evaluation,
)

from sprintlab.core.errors import SprintlabError


def record(method, seed, held, credible):
    item = AuditEntry(name="penetration", value=0.01, unit="m", threshold=0.005, passed=credible)
    speed = SpeedRecord(
        top_speed=held,
        trials=10,
        falls=0,
        passed=True,
        held_speed=held,
        peak_speed=held,
        angular_cost=1.0,
        lateral_deviation=0.0,
        cost_of_transport=1.0,
        electrical_power=1.0,
        stride_frequency=3.0,
        duty_factor=(),
        envelope_share=(),
        audit=AuditRecord(items=(item,)),
    )
    search = SearchRecord(speeds=(speed,))
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
        raw=search,
        self_paced=search,
        sprint=None,
        sprint_self_paced=None,
    )


@pytest.fixture
def runs(tmp_path):
    """Seed 2 has the median speed."""
    folder = tmp_path / "runs"
    for seed, held, credible in ((0, 9.0, True), (1, 12.0, False), (2, 11.0, True)):
        run = folder / "sprint" / f"seed-{seed}"
        write_evaluation(run / "evaluation.json", record("sprint", seed, held, credible))
        (run / "policy.onnx").write_bytes(bytes([seed]))
        (run / "curve.csv").write_text("seconds,speed_p999\n")
        (run / "checkpoint.pt").write_bytes(b"large")
    return folder


def test_small_files_and_the_median_policy_are_kept(runs, tmp_path):
    options = Publish(runs=runs, results=tmp_path / "results")
    kept_policy = tmp_path / "results" / "sprint" / "seed-2" / "policy.onnx"
    assert publish(options) == [kept_policy]
    assert kept_policy.read_bytes() == bytes([2])
    kept = sorted(path.name for path in (tmp_path / "results" / "sprint" / "seed-1").iterdir())
    assert kept == ["curve.csv", "evaluation.json"]


def test_the_policy_of_a_run_that_collapsed_is_kept_only_where_all_did(runs, tmp_path):
    options = Publish(runs=runs, results=tmp_path / "results")
    for seed in (0, 2):
        write_evaluation(
            runs / "sprint" / f"seed-{seed}" / "evaluation.json", record("sprint", seed, 1.0, True)
        )
    assert [path.parent.name for path in publish(options)] == ["seed-1"]
    write_evaluation(runs / "sprint" / "seed-1" / "evaluation.json", record("sprint", 1, 0.5, True))
    assert [path.parent.name for path in publish(options)] == ["seed-0"]


def test_only_the_median_run_keeps_its_cloud(runs, tmp_path):
    options = Publish(runs=runs, results=tmp_path / "results")
    clouds = [options.results / "sprint" / f"seed-{seed}" / "cloud.npz" for seed in range(3)]
    clouds[0].parent.mkdir(parents=True)
    clouds[0].write_bytes(b"of an older median run")
    for seed in range(3):
        (runs / "sprint" / f"seed-{seed}" / "cloud.npz").write_bytes(bytes([seed]))
    publish(options)
    assert [path.exists() for path in clouds] == [False, False, True]
    assert clouds[2].read_bytes() == bytes([2])
    (runs / "sprint" / "seed-2" / "cloud.npz").unlink()
    publish(options)
    assert not any(path.exists() for path in clouds)  # none stays but that of another training


def test_clouds_survive_where_runs_are_published_onto_themselves(runs, tmp_path):
    for seed in range(3):
        (runs / "sprint" / f"seed-{seed}" / "cloud.npz").write_bytes(bytes([seed]))
    publish(Publish(runs=runs, results=runs))
    kept = [(runs / "sprint" / f"seed-{seed}" / "cloud.npz").read_bytes() for seed in range(3)]
    assert kept == [bytes([seed]) for seed in range(3)]


def test_a_policy_beside_the_runs_of_a_method_is_kept(runs, tmp_path):
    options = Publish(runs=runs, results=tmp_path / "results")
    for name in ("seed-1-old", "kept"):
        (options.results / "sprint" / name).mkdir(parents=True)
        (options.results / "sprint" / name / "policy.onnx").write_bytes(b"of somebody else")
    before = content_of(options.results)
    publish(options)
    assert {path: path.read_bytes() for path in before} == before


def test_a_cloud_that_is_a_link_to_itself_is_none(runs, tmp_path):
    options = Publish(runs=runs, results=tmp_path / "results")
    for folder in (runs / "sprint" / "seed-2", options.results / "sprint" / "seed-1"):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "cloud.npz").symlink_to("cloud.npz")
    publish(options)
    assert not list(options.results.glob("*/*/cloud.npz"))


def test_a_run_that_was_not_evaluated_is_refused(runs, tmp_path):
    (runs / "sprint" / "seed-0" / "evaluation.json").unlink()
    options = Publish(runs=runs, results=tmp_path / "results")
    with pytest.raises(SprintlabError, match=r"no policy or evaluation in .*seed-0: run .*studies"):
        publish(options)
    assert not options.results.exists()


def test_a_run_of_train_gets_its_curve_from_its_log(runs, tmp_path):
    run = runs / "sprint" / "seed-2"
    (run / "curve.csv").unlink()
    rows = [{"iteration": index, "seconds": 0.1 * index, "speed_p999": 0.01 * index} for index in range(2000)]
    (run / "log.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    options = Publish(runs=runs, results=tmp_path / "results")
    publish(options)
    curve = read_curve(options.results / "sprint" / "seed-2" / "curve.csv")
    assert len(curve["seconds"]) == 101 and curve["speed_p999"][-1] == pytest.approx(19.99)
    rows[-1]["of_a_later_version"] = 1.0
    (run / "log.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    publish(options)
    (run / "log.jsonl").write_text("{")
    with pytest.raises(SprintlabError, match=r"log\.jsonl is no training log"):
        publish(options)


@pytest.mark.parametrize("name", ["run.toml", "curve.csv", "policy.onnx"])
def test_what_a_link_points_to_is_not_published(runs, tmp_path, name):
    (tmp_path / "secret").write_text("mine")
    link = runs / "sprint" / "seed-2" / name
    link.unlink(missing_ok=True)
    link.symlink_to(tmp_path / "secret")
    with pytest.raises(SprintlabError, match="is a link"):
        publish(Publish(runs=runs, results=tmp_path / "results"))


@pytest.mark.parametrize("text", ["", "seconds,speed_p999\n" + "9" * 140_000, "seconds,speed_p999\n\xff"])
def test_a_curve_that_is_none_ends_in_no_traceback(runs, tmp_path, text):
    path = runs / "sprint" / "seed-0" / "curve.csv"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(SprintlabError, match="learning curve"):
        read_curve(path)
    try:
        publish(Publish(runs=runs, results=tmp_path / "results"))
    except SprintlabError as refused:
        assert "learning curve" in str(refused)


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("curve.csv", "seconds,speed_p999\n" + "1,1\n" * 100_000, "more than 100000 lines"),
        ("curve.csv", "seconds,speed_p999\n0,1e13\n", r"beyond 1e\+12"),
        ("log.jsonl", '{"a":1}\n' * 100_001, "more than 100000 lines"),
    ],
)
def test_files_of_a_training_that_no_training_writes_are_refused(runs, tmp_path, name, text, match):
    path = runs / "sprint" / "seed-0" / name
    path.with_name("curve.csv").unlink(missing_ok=True)
    path.write_text(text)
    with pytest.raises(SprintlabError, match=match):
        read_curve(path) if name == "curve.csv" else publish(Publish(runs=runs, results=tmp_path / "results"))


@pytest.mark.parametrize(
    "line",
    ["[" + "0," * 16_000_000 + "0]", '{"a":[' + "{}," * 10_000_000 + "{}]}", '"{"', '{"a":"b"}'],
    ids=["list", "objects", "text", "row of texts"],
)
def test_a_log_without_rows_is_refused_before_its_lists_are_read(runs, tmp_path, line):
    (runs / "sprint" / "seed-0" / "curve.csv").unlink()
    (runs / "sprint" / "seed-0" / "log.jsonl").write_text(f"{line}\n")
    started = time.process_time()
    with pytest.raises(SprintlabError, match="a line is no row of numbers"):
        publish(Publish(runs=runs, results=tmp_path / "results"))
    assert time.process_time() - started < 3.0  # the lists take 6 s and more


def test_a_wide_curve_of_many_short_rows_takes_no_longer_than_its_bytes(runs):
    path = runs / "sprint" / "seed-0" / "curve.csv"
    wide = ",".join(f"c{number}" for number in range(20_000))
    path.write_text(f"seconds,speed_p999,{wide}\n" + "1,2\n" * 50_000)
    started = time.process_time()
    assert read_curve(path)["speed_p999"].tolist() == [2.0] * 50_000
    assert time.process_time() - started < 5.0  # a name for each missing cell of each row takes minutes


def moved_away(folder, elsewhere):
    """A folder that is a link to where its content lies now."""
    folder.rename(elsewhere)
    folder.symlink_to(elsewhere, target_is_directory=True)
    return content_of(elsewhere)


def content_of(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("place", ["sprint", "sprint/seed-2"])
@pytest.mark.parametrize("command", ["table", "variants", "own-motor", "publish"])
def test_no_command_writes_through_a_run_that_is_a_link(call, runs, tmp_path, monkeypatch, command, place):
    monkeypatch.chdir(tmp_path)  # results and cache lie here
    before = moved_away(runs / place, tmp_path / "elsewhere")
    outcome = call(command, runs)
    assert outcome.status == 2 and "is a link" in outcome.err
    assert content_of(tmp_path / "elsewhere") == before


@pytest.mark.parametrize("seed", [2, 9])
def test_results_behind_a_link_are_neither_written_nor_removed(runs, tmp_path, seed):
    results, elsewhere = tmp_path / "results", tmp_path / "elsewhere"
    (results / "sprint" / f"seed-{seed}").mkdir(parents=True)
    (results / "sprint" / f"seed-{seed}" / "policy.onnx").write_bytes(b"of somebody else")
    before = moved_away(results / "sprint" / f"seed-{seed}", elsewhere)
    with suppress(SprintlabError):  # refused, or left alone
        publish(Publish(runs=runs, results=results))
    assert content_of(elsewhere) == before

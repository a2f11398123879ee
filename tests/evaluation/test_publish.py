"""The recipe that puts finished runs where they are committed."""

import json

import pytest

from sprintlab.core.errors import SprintlabError
from sprintlab.evaluation.ablation.gallery import read_curve
from sprintlab.evaluation.ablation.record import (
    AuditEntry,
    AuditRecord,
    EvaluationRecord,
    SearchRecord,
    SpeedRecord,
    write_evaluation,
)


@pytest.fixture(scope="module")
def recipe(load_script):
    return load_script("recipes/publish_methods.py")


def record(method, seed, held, honest):
    item = AuditEntry(name="penetration", value=0.01, unit="m", threshold=0.005, passed=honest)
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
    """Seed 1 is the fastest, but fails the audit; seed 2 is the fastest honest one."""
    folder = tmp_path / "runs"
    for seed, held, honest in ((0, 9.0, True), (1, 12.0, False), (2, 11.0, True)):
        run = folder / "sprint" / f"seed-{seed}"
        write_evaluation(run / "evaluation.json", record("sprint", seed, held, honest))
        (run / "policy.onnx").write_bytes(bytes([seed]))
        (run / "curve.csv").write_text("seconds,speed_p999\n")
        (run / "checkpoint.pt").write_bytes(b"large")
    return folder


def test_small_files_and_the_best_honest_policy_are_kept(recipe, runs, tmp_path):
    options = recipe.Options(runs=runs, results=tmp_path / "results", policies=tmp_path / "policies")
    assert recipe.publish(options) == [tmp_path / "policies" / "sprint.onnx"]
    assert (tmp_path / "policies" / "sprint.onnx").read_bytes() == bytes([2])
    kept = sorted(path.name for path in (tmp_path / "results" / "sprint" / "seed-1").iterdir())
    assert kept == ["curve.csv", "evaluation.json"]


def test_only_the_best_run_keeps_its_cloud(recipe, runs, tmp_path):
    options = recipe.Options(runs=runs, results=tmp_path / "results", policies=tmp_path / "policies")
    clouds = [options.results / "sprint" / f"seed-{seed}" / "cloud.npz" for seed in range(3)]
    clouds[0].parent.mkdir(parents=True)
    clouds[0].write_bytes(b"of an older best run")
    for seed in range(3):
        (runs / "sprint" / f"seed-{seed}" / "cloud.npz").write_bytes(bytes([seed]))
    recipe.publish(options)
    assert [path.exists() for path in clouds] == [False, False, True]
    assert clouds[2].read_bytes() == bytes([2])
    (runs / "sprint" / "seed-2" / "cloud.npz").unlink()
    recipe.publish(options)
    assert not any(path.exists() for path in clouds)  # none is better than that of another training


def test_clouds_survive_where_runs_are_published_onto_themselves(recipe, runs, tmp_path):
    for seed in range(3):
        (runs / "sprint" / f"seed-{seed}" / "cloud.npz").write_bytes(bytes([seed]))
    recipe.publish(recipe.Options(runs=runs, results=runs, policies=tmp_path / "policies"))
    kept = [(runs / "sprint" / f"seed-{seed}" / "cloud.npz").read_bytes() for seed in range(3)]
    assert kept == [bytes([seed]) for seed in range(3)]


def test_a_run_that_was_not_evaluated_is_refused(recipe, runs, tmp_path):
    (runs / "sprint" / "seed-0" / "evaluation.json").unlink()
    options = recipe.Options(runs=runs, results=tmp_path / "results", policies=tmp_path / "policies")
    with pytest.raises(SprintlabError, match=r"no policy or evaluation in .*seed-0: run sprintlab ablate"):
        recipe.publish(options)
    assert not options.results.exists() and not options.policies.exists()


def test_a_run_of_train_gets_its_curve_from_its_log(recipe, runs, tmp_path):
    run = runs / "sprint" / "seed-2"
    (run / "curve.csv").unlink()
    rows = [{"iteration": index, "seconds": 0.1 * index, "speed_p999": 0.01 * index} for index in range(2000)]
    (run / "log.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    options = recipe.Options(runs=runs, results=tmp_path / "results", policies=tmp_path / "policies")
    recipe.publish(options)
    curve = read_curve(options.results / "sprint" / "seed-2" / "curve.csv")
    assert len(curve["seconds"]) == 101 and curve["speed_p999"][-1] == pytest.approx(19.99)
    (run / "log.jsonl").write_text("{")
    with pytest.raises(SprintlabError, match=r"log\.jsonl is no training log"):
        recipe.publish(options)

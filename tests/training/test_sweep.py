"""Sweeps: the plan, the handing out, and a real worker that is killed."""

from __future__ import annotations

import csv
import json
import os
import shlex
import signal
import subprocess
import sys
import types
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.files import atomic_write_json
from sprintlab.training.methods import method, method_settings
from sprintlab.training.runs.options import TrainOptions
from sprintlab.training.runs.sweep import (
    LocalCluster,
    RunStatus,
    SlurmCluster,
    Sweep,
    curve_text,
    summary,
    visible_gpus,
    work,
)
from sprintlab.training.runs.sweep_plan import RunPlan, parse_variations, plan_sweep
from sprintlab.training.settings_text import parse_assignment, with_changes

LIMITS = {"iterations": 3, "minutes": 5.0, "environments": 8, "device": "cpu", "save_seconds": 0.0}
TINY = {"ppo.steps": 2, "ppo.epochs": 1, "ppo.mini_batches": 2, "ppo.hidden": [16]}


def plans(folder: Path, methods=("acs",), seeds=(0, 1), varied=None, **changes) -> list[RunPlan]:
    return plan_sweep(folder, methods, seeds, TINY, varied or {}, **(LIMITS | changes))


# --- the plan --------------------------------------------------------------------------------------------


def test_every_combination_has_a_folder_and_settings_of_its_own(tmp_path: Path) -> None:
    varied = {"ppo.discount": [0.98, 0.99], "ppo.hidden": [[16], [32, 16]]}
    made = plans(tmp_path, ("acs", "baseline"), varied=varied)
    assert len(made) == 16 == len({plan.folder for plan in made}) == len({plan.digest() for plan in made})
    assert made[0].folder == tmp_path / "ppo.discount=0.98,ppo.hidden=[16]" / "acs" / "seed-0"
    assert made[-1].settings().ppo.hidden == (32, 16)
    assert made[-1].settings().ppo.steps == 2


def test_assignments_are_read_as_numbers_lists_and_words() -> None:
    for text, value in (("a.b=1e-3", 1e-3), ("a.b=[1, 2]", [1, 2]), ("a.b=word", "word")):
        assert parse_assignment(text) == ("a.b", value)
    assert parse_variations(["a=1,2", "b=[1,2],[3]"]) == {"a": [1, 2], "b": [[1, 2], [3]]}
    for bad in ("a", "a=", "=3"):
        with pytest.raises(SprintlabError, match="changes no setting"):
            parse_assignment(bad)


@pytest.mark.parametrize(
    "overrides",
    [
        {},
        {"ppo.std_anneal": [0.1, 0.2], "reward_sum": "clipped"},
        {"ppo.std_anneal": None},
        {"simulation.heat": {}, "ppo.epochs": 2},
        {"simulation.heat": {"ambient_temperature": 30.0}},
        {"simulation.heat": None, "schedule.window": 0.8, "schedule.targets.grid": None},
        {"actuator_model": "square", "schedule.ramp": [1.0, 3.0]},
        {"schedule.targets.grid.yaw_limit": 2.0, "simulation.heat.heat_capacity": 200.0},
    ],
)
def test_the_command_line_of_a_run_trains_the_same(tmp_path: Path, overrides: dict[str, Any]) -> None:
    (plan,) = plan_sweep(tmp_path, ("acs",), (3,), TINY | overrides, {}, **LIMITS)
    words = shlex.split(plan.command_line())
    assert words[:5] == ["sprintlab", "train", "bp2", "--method", "acs"]
    changes = [words[place + 1] for place, word in enumerate(words) if word == "--set"]
    again = TrainOptions(settings=with_changes(method("acs", seed=3), changes), device="cpu")
    assert again.full_settings().digest() == plan.digest()


def test_a_schedule_is_the_methods_own_but_for_what_is_set(tmp_path: Path) -> None:
    varied = {"schedule.window": [0.8, 2.0], "actuator_model": ["square"]}
    made = [plan.options().full_settings() for plan in plans(tmp_path, seeds=(0,), varied=varied)]
    own = method_settings("acs").schedule
    assert [settings.schedule for settings in made] == [replace(own, window=window) for window in (0.8, 2.0)]
    assert {settings.actuator_model for settings in made} == {"square"}
    with pytest.raises(InvalidValueError, match=r"schedule\.window = 0\.8 is not allowed: there is no such"):
        plans(tmp_path, ("baseline",), varied=varied)  # its schedule is uniform


def test_a_folder_with_other_settings_is_refused(tmp_path: Path) -> None:
    plans(tmp_path)[0].begin()
    with pytest.raises(SprintlabError, match="other settings"):
        plans(tmp_path, environments=16)[0].begin()
    plans(tmp_path, iterations=9)[0].begin()  # longer is the same run
    (tmp_path / "acs" / "seed-1").mkdir(parents=True)
    (tmp_path / "acs" / "seed-1" / "checkpoint.pt").write_bytes(b"someone's")
    with pytest.raises(SprintlabError, match="checkpoint of another run"):
        plans(tmp_path)[1].begin()


def test_a_damaged_record_is_refused(tmp_path: Path) -> None:
    plan = plans(tmp_path)[0]
    plan.begin()
    for text in ("{", "[1]"):
        (plan.folder / "run.json").write_text(text)
        with pytest.raises(SprintlabError, match=r"run\.json is "):
            plan.finished()


def test_a_curve_is_thinned_and_keeps_its_end() -> None:
    log = [{"iteration": float(k), "seconds": 0.1 * k, "speed_p999": 1.0} for k in range(1, 1204)]
    rows = list(csv.DictReader(curve_text(log).splitlines()))
    assert 400 <= len(rows) <= 500
    assert float(rows[-1]["iteration"]) == 1203
    assert len(list(csv.DictReader(curve_text(log[:7]).splitlines()))) == 7
    (first, _) = csv.DictReader(curve_text([{"iteration": 1.0, "gone": 2.0}, log[1]]).splitlines())
    assert first == {"iteration": "1.0", "seconds": "", "speed_p999": ""}, "columns are those of the end"


# --- handing out -----------------------------------------------------------------------------------------


@dataclass
class FakeJob:
    """Ends at the second look; whether its runs are finished then is decided by the cluster."""

    cluster: FakeCluster
    plans: Sequence[RunPlan]
    looks: int = 0

    def done(self, force_check: bool = False) -> bool:
        self.looks += 1
        if self.looks == 2:
            for plan in self.plans:
                if self.cluster.losses.get(plan.seed, 0) > 0:
                    self.cluster.losses[plan.seed] -= 1
                else:
                    atomic_write_json(plan.folder / "run.json", {**plan.asked(), "finished": True})
        return self.looks >= 2

    @property
    def job_id(self) -> str:
        return "1"

    def stderr(self) -> str | None:
        return "Traceback\nOutOfMemoryError: no room\n\n"


@dataclass
class FakeCluster:
    slots: int | None = 2
    bundle: int = 1
    losses: dict[int, int] = field(default_factory=dict)
    jobs: list[FakeJob] = field(default_factory=list)
    taken: list[int] = field(default_factory=list)
    left: list[FakeJob] = field(default_factory=list)
    busiest: int = 0

    def leave(self, jobs: Sequence[FakeJob]) -> None:
        self.left.extend(jobs)

    def submit(self, plans: Sequence[RunPlan], slot: int) -> FakeJob:
        self.jobs.append(FakeJob(self, plans))
        self.taken.append(slot)
        self.busiest = max(self.busiest, sum(job.looks < 2 for job in self.jobs))
        return self.jobs[-1]


def test_no_more_jobs_than_slots_and_every_run_once(tmp_path: Path) -> None:
    cluster, seen = FakeCluster(slots=2), []
    sweep = Sweep(plans(tmp_path, seeds=range(5)), cluster)
    sweep.run(lambda runs: seen.append([run.state for run in runs]), pause=0.0)
    assert cluster.busiest == 2
    assert set(cluster.taken) == {0, 1}
    assert sorted(job.plans[0].seed for job in cluster.jobs) == [0, 1, 2, 3, 4]
    assert seen[0] == ["running"] * 2 + ["waiting"] * 3
    assert {run.state for run in sweep.runs} == {"finished"}


def test_a_lost_worker_is_replaced_and_finished_runs_are_skipped(tmp_path: Path) -> None:
    cluster = FakeCluster(losses={1: 2})
    sweep = Sweep(plans(tmp_path), cluster)
    sweep.run(lambda runs: None, pause=0.0)
    assert [run.restarts for run in sweep.runs] == [0, 2]
    assert len(cluster.jobs) == 4
    again = FakeCluster()
    Sweep(plans(tmp_path, seeds=(0, 1, 2)), again).run(lambda runs: None, pause=0.0)
    assert [job.plans[0].seed for job in again.jobs] == [2]


def test_a_run_that_fails_again_and_again_is_reported_and_the_rest_goes_on(tmp_path: Path) -> None:
    sweep = Sweep(plans(tmp_path), FakeCluster(losses={0: 99}), retries=1)
    with pytest.raises(SprintlabError, match=r"1 of 2 runs failed: acs 0: OutOfMemoryError: no room"):
        sweep.run(lambda runs: None, pause=0.0)
    assert [run.state for run in sweep.runs] == ["failed", "finished"]
    assert [row["state"] for row in summary(sweep.runs)] == ["failed", "finished"]


def test_jobs_that_share_a_gpu_are_bundled(tmp_path: Path) -> None:
    cluster = FakeCluster(slots=None, bundle=2)
    Sweep(plans(tmp_path, seeds=range(5)), cluster).run(lambda runs: None, pause=0.0)
    assert [len(job.plans) for job in cluster.jobs] == [2, 2, 1]


def test_an_interrupted_sweep_leaves_its_jobs_to_the_cluster_and_goes_on_later(tmp_path: Path) -> None:
    cluster = FakeCluster()

    def interrupt(_runs: Sequence[RunStatus]) -> None:
        raise KeyboardInterrupt

    sweep = Sweep(plans(tmp_path), cluster)
    with pytest.raises(KeyboardInterrupt):
        sweep.run(interrupt)
    assert cluster.left == cluster.jobs
    assert [run.state for run in sweep.runs] == ["waiting"] * 2
    Sweep(plans(tmp_path), cluster).run(lambda runs: None, pause=0.0)
    assert cluster.left == cluster.jobs[:2]


def test_local_workers_are_asked_to_end_and_then_killed(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("sprintlab.training.runs.sweep.LEAVE_SECONDS", 2)
    deaf = "import signal, time; signal.signal(15, signal.SIG_IGN); print('on', flush=True); time.sleep(60)"
    started = [
        subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
        for code in (deaf, deaf.replace("SIG_IGN", "SIG_DFL"))
    ]
    for process in started:
        process.stdout.readline()
    jobs = [
        types.SimpleNamespace(job_id=str(each.pid), done=lambda e=each: e.poll() is not None)
        for each in started
    ]
    LocalCluster(tmp_path, 1, [], 1.0).leave(jobs)
    assert [process.wait(5) for process in started] == [-signal.SIGKILL, -signal.SIGTERM]


def test_slots_are_gpus_times_trainings_on_each(tmp_path: Path, monkeypatch) -> None:
    assert LocalCluster(tmp_path, 2, [0, 3], 1.0).slots == 4
    assert LocalCluster(tmp_path, 3, [], 1.0).slots == 3
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "2,5")
    assert visible_gpus() == [2, 5]
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "²,3")
    assert visible_gpus() == [3]
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    assert visible_gpus() == []


# --- Slurm -----------------------------------------------------------------------------------------------


@pytest.fixture
def slurm(tmp_path: Path, monkeypatch) -> Path:
    """A folder with a ``sbatch`` that keeps the script it is given."""
    pytest.importorskip("submitit")
    folder = tmp_path / "bin"
    folder.mkdir()
    (folder / "sbatch").write_text(f"#!/bin/sh\ncp $1 {folder}/script.sh\necho Submitted batch job 17\n")
    for name in ("srun", "sacct", "scancel"):
        (folder / name).write_text("#!/bin/sh\n")
    for program in folder.iterdir():
        program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    return folder


def test_a_slurm_job_has_one_gpu_and_a_task_for_each_training(slurm: Path, tmp_path: Path) -> None:
    cluster = SlurmCluster(tmp_path / "jobs", 2, 50.0, "fast")
    assert cluster.bundle == 2 and cluster.slots is None
    job = cluster.submit(plans(tmp_path), 0)
    assert job.job_id == "17"
    script = (slurm / "script.sh").read_text()
    for line in ("--gpus-per-node=1", "--ntasks-per-node=2", "--partition=fast", "--time=50"):
        assert f"#SBATCH {line}" in script


def test_each_task_of_a_job_trains_its_own_run(tmp_path: Path, monkeypatch) -> None:
    submitit = pytest.importorskip("submitit")
    trained: list[int] = []
    monkeypatch.setattr("sprintlab.training.runs.sweep.train_run", lambda plan: trained.append(plan.seed))
    for rank in (1, 0):
        environment = types.SimpleNamespace(local_rank=rank)
        monkeypatch.setattr(submitit, "JobEnvironment", lambda environment=environment: environment)
        work(plans(tmp_path, seeds=(4, 5)))
    assert trained == [5, 4]


def test_without_slurm_it_is_refused(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(SprintlabError, match="no Slurm here"):
        SlurmCluster(tmp_path, 1, 50.0, None)


# --- a real worker ---------------------------------------------------------------------------------------


class ForkedWorker:
    """The work of a job in a copy of this process, which has imported what it needs."""

    def __init__(self, plans: Sequence[RunPlan]) -> None:
        self.job_id = str(child := os.fork())
        self.status: int | None = None
        if child == 0:
            status = 1
            try:
                work(plans)
                status = 0
            finally:
                os._exit(status)

    def done(self, force_check: bool = False) -> bool:
        if self.status is None and os.waitpid(int(self.job_id), os.WNOHANG)[0]:
            self.status = 0
        return self.status is not None

    def stderr(self) -> str | None:
        return None


class OneInterpreter(LocalCluster):
    """The first worker is the one that users get; those in its place begin at once."""

    started = 0

    def submit(self, plans: Sequence[RunPlan], slot: int) -> Any:
        self.started += 1
        return super().submit(plans, slot) if self.started == 1 else ForkedWorker(plans)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
def test_a_killed_worker_goes_on_from_its_checkpoint(tmp_path: Path, monkeypatch) -> None:
    pytest.importorskip("torch")
    pytest.importorskip("submitit")
    import torch

    torch.set_num_threads(1)  # no pool that a fork would lose
    made = plans(tmp_path, seeds=(0,), iterations=3)
    victim = made[0].folder
    killed: list[int] = []

    def kill(_runs: Sequence[RunStatus]) -> None:
        if not killed and (victim / "checkpoint.pt").exists():
            killed.append(int((victim / ".lock").read_text()))
            os.kill(killed[0], signal.SIGKILL)

    sweep = Sweep(made, OneInterpreter(tmp_path / ".jobs", 2, [], 10.0))
    sweep.run(kill, pause=0.02)
    assert [run.restarts for run in sweep.runs] == [1]
    assert int((victim / ".lock").read_text()) != killed[0]
    for plan in made:
        rows = [json.loads(line) for line in (plan.folder / "log.jsonl").read_text().splitlines()]
        assert [row["iteration"] for row in rows] == [1, 2, 3]
        files = {path.name for path in plan.folder.iterdir()}
        complete = {"checkpoint.pt", "curve.csv", "policy.onnx", "run.json", "tensorboard"}
        assert complete <= files
        record = plan.record()
        assert record is not None
        assert record["reached_iterations"] == 3
        assert record["command_line"] == plan.command_line()

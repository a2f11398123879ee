"""Sweeps: the plan, the handing out, and runs that are lost."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.training.methods import method
from sprintlab.training.runs import sweep as sweep_module
from sprintlab.training.runs.options import TrainOptions
from sprintlab.training.runs.sweep import SweptRun, parse_variations, plan_sweep, train_all
from sprintlab.training.settings_text import with_changes


def plans(folder: Path, methods=("acs",), seeds=(0, 1), **given) -> list[SweptRun]:
    limits = {"iterations": 3, "environments": 8, "device": "cpu"}
    return plan_sweep(folder, methods=methods, seeds=seeds, **(limits | given))


def test_every_combination_has_a_folder_and_settings_of_its_own(tmp_path: Path) -> None:
    varied = {"ppo.discount": ["0.98", "0.99"], "ppo.hidden": ["[16]", "[32, 16]"]}
    made = plans(tmp_path, ("acs", "baseline"), varied=varied)
    assert len(made) == 16 == len({run.folder for run in made}) == len({run.digest for run in made})
    assert made[0].folder == tmp_path / "ppo.discount=0.98,ppo.hidden=[16]" / "acs" / "seed-0"
    with pytest.raises(InvalidValueError, match=r"schedule\.window = 0\.8 is not allowed: there is no such"):
        plans(tmp_path, ("baseline",), varied={"schedule.window": ["0.8"]})  # its schedule is uniform


def test_values_to_vary_are_numbers_lists_and_words() -> None:
    found = parse_variations(["a=1,2", "b=[1,2],[3]", "c=square,refined"])
    assert found == {"a": ["1", "2"], "b": ["[1,2]", "[3]"], "c": ["square", "refined"]}
    with pytest.raises(SprintlabError, match="changes no setting"):
        parse_variations(["a"])


@pytest.mark.parametrize(
    "fixed",
    [
        [],
        ["stages.record_margin=none", "reward_sum=clipped", "schedule.ramp=[1.0, 3.0]"],
        ["simulation.heat={ambient_temperature = 30.0}", "schedule.targets.grid=none"],
    ],
)
def test_the_command_of_a_run_trains_the_same(tmp_path: Path, fixed: list[str]) -> None:
    (run,) = plans(tmp_path, seeds=(3,), fixed=fixed, varied={"ppo.epochs": ["2"]}, preset="paper")
    words = shlex.split(run.command)
    assert words[:4] == ["sprintlab", "train", "bp2", "--method"] and "--resume" in words
    changes = [words[place + 1] for place, word in enumerate(words) if word == "--set"]
    settings = with_changes(method("acs", seed=3, preset="paper"), changes)
    again = TrainOptions(settings=settings, device="cpu", environments=8)
    assert again.full_settings().digest() == run.digest


def test_a_folder_with_other_settings_is_refused(tmp_path: Path) -> None:
    run = plans(tmp_path)[0]
    run.folder.mkdir(parents=True)
    (run.folder / "run.toml").write_text(f"# hash: {run.digest}\n")
    run.check()
    with pytest.raises(SprintlabError, match="other settings"):
        plans(tmp_path, environments=16)[0].check()


WORKER = """
import pathlib, sys, time
folder = pathlib.Path(sys.argv[sys.argv.index("--output") + 1])
lost = {lost}.get(folder.name, 0)
starts = folder / "starts"
starts.write_text(starts.read_text() + "x" if starts.exists() else "x")
if len(starts.read_text()) <= lost:
    sys.exit("OutOfMemoryError: no room")
(folder / "policy.onnx").write_text("trained")
"""


def workers(monkeypatch: pytest.MonkeyPatch, code: str = WORKER, **lost: int) -> None:
    """Runs are not trained: they end at once, some of them several times without a policy."""
    named = {name.replace("_", "-"): count for name, count in lost.items()}
    command = [sys.executable, "-c", code.replace("{lost}", repr(named))]
    monkeypatch.setattr(sweep_module, "new_interpreter", lambda: command)


def starts(run: SweptRun) -> int:
    path = run.folder / "starts"
    return len(path.read_text()) if path.exists() else 0


def test_every_run_is_trained_once_and_no_more_at_a_time_than_devices(tmp_path: Path, monkeypatch) -> None:
    workers(monkeypatch)
    runs, seen = plans(tmp_path, seeds=range(5)), []
    train_all(runs, ["cpu", "cpu"], 0, lambda states: seen.append(list(states.values())), pause=0.01)
    assert max(states.count("running") for states in seen) == 2 and set(seen[-1]) == {"finished"}
    train_all([*runs, *plans(tmp_path, seeds=(5,))], ["cpu"], 0, lambda states: None, pause=0.01)
    assert [starts(run) for run in plans(tmp_path, seeds=range(6))] == [1] * 6


def test_on_a_gpu_two_runs_prepare_at_a_time(tmp_path: Path, monkeypatch) -> None:
    workers(monkeypatch, "import time; time.sleep(60)")
    runs, seen = plans(tmp_path, seeds=range(4)), []

    def prepared(states: Mapping[str, str]) -> None:
        seen.append(list(states.values()).count("running"))
        (runs[len(seen) - 1].folder / "run.toml").write_text(f"# hash: {runs[0].digest}\n")
        if len(seen) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_all(runs, ["cuda:0"] * 4, 0, prepared, pause=0.01)
    assert seen == [2, 3]


def test_a_lost_run_is_started_again_until_it_has_failed_too_often(tmp_path: Path, monkeypatch) -> None:
    workers(monkeypatch, seed_0=2, seed_1=9)
    runs, seen = plans(tmp_path), []
    with pytest.raises(SprintlabError, match=r"1 of 2 runs failed: acs 1: OutOfMemoryError: no room"):
        train_all(runs, ["cpu"], 2, lambda states: seen.append(dict(states)), pause=0.01)
    assert list(seen[-1].values()) == ["finished", "failed"] and [starts(run) for run in runs] == [3, 3]


def test_an_interrupted_sweep_ends_its_runs(tmp_path: Path, monkeypatch) -> None:
    workers(monkeypatch, "import time; time.sleep(60)")

    def interrupt(_states: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_all(plans(tmp_path), ["cpu", "cpu"], 0, interrupt)

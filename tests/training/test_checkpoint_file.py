"""A checkpoint runs no code, notices damage, and keeps settings of one's own."""

from __future__ import annotations

import io
import pickle
import sys
import types
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from sprintlab.core.errors import SprintlabError
from sprintlab.training.runs.checkpoint import (
    Progress,
    UnknownSettings,
    read_checkpoint,
    unknown_settings,
    write_checkpoint,
)
from sprintlab.training.settings import RewardSettings, RewardWeight, TrainingSettings

_SIDEWAYS = RewardWeight(first=-0.5, second=-2.0)


@dataclass(frozen=True, kw_only=True)
class OwnRewards(RewardSettings):
    sideways_velocity: RewardWeight = _SIDEWAYS


def state(settings: TrainingSettings | None = None) -> dict:
    settings = settings or TrainingSettings()
    return {
        "settings": settings,
        "config_hash": settings.digest(),
        "command_line": "sprintlab train sprint",
        "device": "CPU",
        "versions": {"torch": "2"},
        "date": "2026-01-01",
        "progress": Progress(iteration=2, log=[{"iteration": 1, "reward": 0.1 + 0.2}]),
        "policy": {"0.weight": torch.zeros(1)},
        "learner": {
            "actor": {"0.weight": torch.randn(3, 4), "count": torch.tensor(5), "empty": torch.zeros(0, 2)},
            "moments": [torch.randn(7), torch.randn(2, 2).to(torch.bfloat16)],
        },
        "generators": {"numpy": np.random.RandomState(3).get_state(), "torch": torch.get_rng_state()},
    }


@pytest.fixture
def path(tmp_path: Path) -> Path:
    target = tmp_path / "checkpoint.pt"
    write_checkpoint(state(), target)
    return target


def test_everything_comes_back_as_it_was(tmp_path: Path) -> None:
    given = state()
    write_checkpoint(given, tmp_path / "c.pt")
    read = read_checkpoint(tmp_path / "c.pt")
    assert read["settings"] == given["settings"] and read["settings"].digest() == given["config_hash"]
    assert read["progress"] == given["progress"]
    for name, tensor in given["learner"]["actor"].items():
        assert torch.equal(read["learner"]["actor"][name], tensor)
    for mine, theirs in zip(read["learner"]["moments"], given["learner"]["moments"], strict=True):
        assert mine.dtype == theirs.dtype and torch.equal(mine, theirs)
    generator = np.random.RandomState()
    generator.set_state(read["generators"]["numpy"])
    assert generator.random_sample() == np.random.RandomState(3).random_sample()


@pytest.mark.parametrize("seed", range(12))
def test_a_flipped_bit_is_refused_or_changes_nothing(path: Path, seed: int) -> None:
    original, content = read_checkpoint(path), bytearray(path.read_bytes())
    place = int(np.random.default_rng(seed).integers(len(content) * 8))
    content[place // 8] ^= 1 << place % 8
    path.write_bytes(content)
    try:
        read = read_checkpoint(path)
    except SprintlabError as refusal:
        assert "\n" not in str(refusal)
    else:  # a bit of the archive's padding, which no checksum covers
        assert torch.equal(read["learner"]["actor"]["0.weight"], original["learner"]["actor"]["0.weight"])


class Evil:
    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self):
        return Path.touch, (self.target,)


@pytest.mark.parametrize("form", ["torch", "pickle"])
def test_a_pickle_is_not_opened(tmp_path: Path, form: str) -> None:
    mark, path = tmp_path / "ran", tmp_path / "checkpoint.pt"
    if form == "torch":
        torch.save({"format": 5, "state": Evil(mark)}, path)
    else:
        path.write_bytes(pickle.dumps(Evil(mark), protocol=2))
    with pytest.raises(SprintlabError, match="not a checkpoint"):
        read_checkpoint(path)
    assert not mark.exists()


def test_a_class_that_is_not_imported_or_not_of_settings_is_not_made(tmp_path: Path) -> None:
    for name in ("subprocess:Popen", "sprintlab.training.runs.checkpoint:Progress", "absent:Own"):
        write_checkpoint({**state(), "more": UnknownSettings(name, {})}, tmp_path / "c.pt")
        assert read_checkpoint(tmp_path / "c.pt")["more"] == UnknownSettings(name, {})
    assert "absent" not in sys.modules


def test_settings_that_their_class_refuses_are_told_in_one_sentence(tmp_path: Path) -> None:
    wrong = UnknownSettings("sprintlab.training.settings:TrainingSettings", {"unheard_of": 1})
    write_checkpoint({**state(), "settings": wrong}, tmp_path / "c.pt")
    with pytest.raises(SprintlabError, match="unheard_of") as refusal:
        read_checkpoint(tmp_path / "c.pt")
    assert "\n" not in str(refusal.value)


def test_what_lacks_a_part_or_is_no_file_is_refused(tmp_path: Path) -> None:
    for name in ("settings", "progress", "policy", "config_hash"):
        write_checkpoint({key: value for key, value in state().items() if key != name}, tmp_path / "c.pt")
        with pytest.raises(SprintlabError, match=f"it has no {name}"):
            read_checkpoint(tmp_path / "c.pt")
    with pytest.raises(SprintlabError, match="no such file"):
        read_checkpoint(tmp_path / "absent.pt")


def test_another_format_is_named(path: Path) -> None:
    content = torch.load(path, weights_only=True)
    torch.save({**content, "format": 4}, path)
    with pytest.raises(SprintlabError, match="format 4; this version reads 5"):
        read_checkpoint(path)


def test_settings_of_ones_own_come_back_where_they_are_known(tmp_path: Path, monkeypatch) -> None:
    settings = replace(TrainingSettings(), rewards=OwnRewards())
    write_checkpoint(state(settings), tmp_path / "c.pt")
    known = types.ModuleType(OwnRewards.__module__)
    known.OwnRewards = OwnRewards
    monkeypatch.setitem(sys.modules, OwnRewards.__module__, known)
    assert read_checkpoint(tmp_path / "c.pt")["settings"] == settings
    monkeypatch.delitem(sys.modules, OwnRewards.__module__)
    read = read_checkpoint(tmp_path / "c.pt")
    assert unknown_settings(read["settings"]) == [f"{OwnRewards.__module__}:OwnRewards"]
    assert read["config_hash"] == settings.digest()  # what an export needs is there all the same
    write_checkpoint(read, tmp_path / "again.pt")
    assert read_checkpoint(tmp_path / "again.pt")["settings"] == read["settings"]


def test_what_cannot_be_kept_is_named(tmp_path: Path) -> None:
    with pytest.raises(SprintlabError, match=r"state\.device is of BytesIO"):
        write_checkpoint({**state(), "device": io.BytesIO()}, tmp_path / "c.pt")
    assert list(tmp_path.iterdir()) == []

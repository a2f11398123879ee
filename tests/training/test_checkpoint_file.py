"""A checkpoint runs no code, notices damage, and keeps settings of one's own."""

from __future__ import annotations

import io
import json
import pickle
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from sprintlab.core.errors import SprintlabError
from sprintlab.training.runs.checkpoint import Progress, read_checkpoint, write_checkpoint
from sprintlab.training.settings import TrainingSettings
from sprintlab.training.terms import term


def sideways_velocity(step):
    """Squared sideways velocity of the base."""
    return step.body.velocity[:, 1].square()


def state(settings: TrainingSettings | None = None) -> dict:
    settings = settings or TrainingSettings()
    return {
        "settings": settings,
        "config_hash": settings.digest(),
        "command_line": "sprintlab train bp2",
        "device": "CPU",
        "versions": {"torch": "2"},
        "date": "2026-01-01",
        "progress": Progress(iteration=2, log=[{"iteration": 1, "reward": 0.1 + 0.2}]),
        "policy": {"0.weight": torch.zeros(1)},
        "learner": {
            "actor": {"0.weight": torch.randn(3, 4), "count": torch.tensor(5), "empty": torch.zeros(0, 2)},
            "moments": [torch.randn(7), torch.randn(2, 2).to(torch.bfloat16)],
        },
        "generators": {"torch": torch.get_rng_state()},
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
    assert torch.equal(read["generators"]["torch"], given["generators"]["torch"])


@pytest.mark.parametrize("seed", range(6))
def test_a_truncated_file_is_refused_and_a_flipped_bit_or_it_changes_nothing(path: Path, seed: int) -> None:
    original, content = read_checkpoint(path), bytearray(path.read_bytes())
    place = int(np.random.default_rng(seed).integers(len(content) * 8))
    content[place // 8] ^= 1 << place % 8
    path.write_bytes(content[: int(0.15 * seed * len(content))])
    with pytest.raises(SprintlabError, match=r"checkpoint\.pt") as truncated:
        read_checkpoint(path)
    assert "\n" not in str(truncated.value)
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
        torch.save({"format": 6, "state": Evil(mark)}, path)
    else:
        path.write_bytes(pickle.dumps(Evil(mark), protocol=2))
    with pytest.raises(SprintlabError, match="not a checkpoint"):
        read_checkpoint(path)
    assert not mark.exists()


@pytest.mark.parametrize("function", ["subprocess:nothing", "absent:own", "banana"])
def test_a_function_that_is_not_imported_is_told_in_one_sentence(tmp_path: Path, function: str) -> None:
    write_checkpoint(state(), tmp_path / "c.pt")
    content = torch.load(tmp_path / "c.pt", weights_only=True)
    settings = json.loads(content["state"]["settings"])
    settings["reward"]["progress"]["function"] = function
    content["state"]["settings"] = json.dumps(settings)
    torch.save(content, tmp_path / "c.pt")
    with pytest.raises(SprintlabError, match=r"reward\.progress\.function") as refusal:
        read_checkpoint(tmp_path / "c.pt")
    assert "\n" not in str(refusal.value) and "absent" not in sys.modules


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
    with pytest.raises(SprintlabError, match="format 4; this version reads 6"):
        read_checkpoint(path)


def test_a_term_of_ones_own_comes_back(tmp_path: Path) -> None:
    default = TrainingSettings()
    own = {**default.reward, "sideways_velocity": term(sideways_velocity, (-0.5, -2.0))}
    settings = replace(default, reward=own)
    write_checkpoint(state(settings), tmp_path / "c.pt")
    assert read_checkpoint(tmp_path / "c.pt")["settings"] == settings


def test_what_cannot_be_kept_is_named(tmp_path: Path) -> None:
    with pytest.raises(SprintlabError, match=r"state\.device is of BytesIO"):
        write_checkpoint({**state(), "device": io.BytesIO()}, tmp_path / "c.pt")
    assert list(tmp_path.iterdir()) == []

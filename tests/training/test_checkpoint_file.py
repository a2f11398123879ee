"""A checkpoint runs no code, notices damage, and keeps settings of one's own."""

from __future__ import annotations

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


def state() -> dict:
    default = TrainingSettings()
    own = {**default.reward, "sideways_velocity": term(sideways_velocity, (-0.5, -2.0))}
    return {
        "settings": replace(default, reward=own),
        "progress": Progress(iteration=2, log=[{"iteration": 1, "reward": 0.1 + 0.2}]),
        "learner": {"weight": torch.randn(3, 4), "moments": [torch.randn(2, 2).to(torch.bfloat16)]},
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
    assert read["settings"] == given["settings"] and read["progress"] == given["progress"]
    assert torch.equal(read["learner"]["weight"], given["learner"]["weight"])
    mine, theirs = read["learner"]["moments"][0], given["learner"]["moments"][0]
    assert mine.dtype == theirs.dtype and torch.equal(mine, theirs)


@pytest.mark.parametrize("seed", range(6))
def test_a_truncated_file_is_refused_and_a_flipped_bit_or_it_changes_nothing(path: Path, seed: int) -> None:
    original, content = read_checkpoint(path), bytearray(path.read_bytes())
    place = int(np.random.default_rng(seed).integers(len(content) * 8))
    content[place // 8] ^= 1 << place % 8
    path.write_bytes(content[: int(0.15 * seed * len(content))])
    with pytest.raises(SprintlabError, match=r"checkpoint\.pt"):
        read_checkpoint(path)
    path.write_bytes(content)
    try:
        read = read_checkpoint(path)
    except SprintlabError:
        return
    # a bit of the archive's padding, which no checksum covers
    assert torch.equal(read["learner"]["weight"], original["learner"]["weight"])


class Evil:
    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self):
        return Path.touch, (self.target,)


def test_a_pickle_is_not_opened(tmp_path: Path) -> None:
    mark, path = tmp_path / "ran", tmp_path / "checkpoint.pt"
    torch.save({"format": 8, "state": Evil(mark)}, path)
    with pytest.raises(SprintlabError, match="not a checkpoint"):
        read_checkpoint(path)
    path.write_bytes(pickle.dumps(Evil(mark), protocol=2))
    with pytest.raises(SprintlabError, match="not a checkpoint"):
        read_checkpoint(path)
    assert not mark.exists()


@pytest.mark.parametrize("function", ["subprocess:nothing", "absent:own", "banana"])
def test_a_function_that_is_not_imported_is_told_in_one_sentence(path: Path, function: str) -> None:
    content = torch.load(path, weights_only=True)
    settings = json.loads(content["state"]["settings"])
    settings["reward"]["progress"]["function"] = function
    content["state"]["settings"] = json.dumps(settings)
    torch.save(content, path)
    with pytest.raises(SprintlabError, match=r"reward\.progress\.function"):
        read_checkpoint(path)
    assert "absent" not in sys.modules


def test_another_format_is_named(path: Path) -> None:
    torch.save({"format": 4, "state": {}}, path)
    with pytest.raises(SprintlabError, match="format 4; this version reads 8"):
        read_checkpoint(path)

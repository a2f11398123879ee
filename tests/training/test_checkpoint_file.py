"""A checkpoint runs no code, notices every flipped bit, and keeps settings of one's own."""

from __future__ import annotations

import importlib
import io
import json
import pickle
import struct
import sys
import types
from dataclasses import dataclass, make_dataclass, replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco_warp")

import torch

from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.reading import parse_json
from sprintlab.training.runs import checkpoint as module
from sprintlab.training.runs.checkpoint import (
    MOST_ITERATIONS,
    Progress,
    UnknownSettings,
    check_checkpoint,
    read_checkpoint,
    unknown_settings,
    write_checkpoint,
)
from sprintlab.training.runs.options import TrainOptions
from sprintlab.training.settings import RewardSettings, RewardWeight, TrainingSettings

_SIDEWAYS = RewardWeight(first=-0.5, second=-2.0)


@dataclass(frozen=True, kw_only=True)
class OwnRewards(RewardSettings):
    sideways_velocity: RewardWeight = _SIDEWAYS


@dataclass(frozen=True, kw_only=True)
class Strict:
    weight: float

    def __post_init__(self) -> None:
        assert self.weight > 0.0, "no weight"


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


def test_a_setting_that_is_gone_is_read_where_it_did_nothing(tmp_path: Path) -> None:
    given = state()
    settings = given["settings"]
    for value in (False, True):
        older = UnknownSettings(
            "sprintlab.training.settings:PpoSettings", {**vars(settings.ppo), "mirror_epochs": value}
        )
        write_checkpoint({**given, "ppo": older}, tmp_path / f"{value}.pt")
    assert read_checkpoint(tmp_path / "False.pt")["ppo"] == settings.ppo
    with pytest.raises(SprintlabError, match="mirror_epochs"):
        read_checkpoint(tmp_path / "True.pt")


@pytest.mark.parametrize("seed", range(40))
def test_every_flipped_bit_is_noticed(path: Path, seed: int) -> None:
    content = bytearray(path.read_bytes())
    place = int(np.random.default_rng(seed).integers(len(content) * 8))
    content[place // 8] ^= 1 << place % 8
    path.write_bytes(content)
    for read in (check_checkpoint, read_checkpoint):
        with pytest.raises(SprintlabError) as refusal:
            read(path)
        assert "\n" not in str(refusal.value)


class Evil:
    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self):
        return Path.touch, (self.target,)


@pytest.mark.parametrize("form", ["torch", "pickle"])
def test_a_pickle_is_not_opened(tmp_path: Path, form: str) -> None:
    mark, path = tmp_path / "ran", tmp_path / "checkpoint.pt"
    if form == "torch":
        torch.save({"format": 3, "settings": Evil(mark)}, path)
    else:
        path.write_bytes(pickle.dumps(Evil(mark), protocol=2))
    with pytest.raises(SprintlabError, match="can run code"):
        read_checkpoint(path)
    assert not mark.exists()


def rewritten(path: Path, change) -> None:
    """The file with other values and a checksum that fits: a stranger can make one."""
    content = path.read_bytes()
    (length,) = struct.unpack_from("<Q", content)
    header = json.loads(content[8 : 8 + length])
    values = json.loads(header["__metadata__"]["values"])
    change(values, header)
    header["__metadata__"]["values"] = json.dumps(values)
    header["__metadata__"]["sha256"] = "0" * 64
    text = json.dumps(header).encode()
    whole = struct.pack("<Q", len(text)) + text + content[8 + length :]
    path.write_bytes(whole.replace(b"0" * 64, module._checksum(whole).encode(), 1))


@pytest.mark.parametrize(
    "name",
    [
        "subprocess:Popen",
        "os:system",
        "sprintlab.cli.main:main",
        "sprintlab.training.runs.checkpoint:Progress",
    ],
)
def test_classes_of_no_settings_are_not_made(path: Path, name: str) -> None:
    def change(values, _header):
        values["settings"]["fields"]["rewards"] = {"$class": name, "fields": {}}

    rewritten(path, change)
    try:
        settings = read_checkpoint(path)["settings"]
    except SprintlabError as refusal:
        assert "\n" not in str(refusal)
    else:
        assert isinstance(settings.rewards, UnknownSettings)


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("torch.utils._pytree:TreeSpec", {"type": None, "context": 1, "children_specs": []}),
        (
            "torch._higher_order_ops.invoke_subgraph:NestedCompileRegionOptions",
            {"inductor_config_patches": {}},
        ),
        ("random:Settings", {}),
    ],
)
def test_no_class_of_another_library_is_made(path: Path, name: str, fields: dict, monkeypatch) -> None:
    """Some of them import PyTorch's compiler, which takes seconds; others end in a traceback."""
    where, _, kind = name.partition(":")
    library = importlib.import_module(where)
    if where == "random":
        made = make_dataclass(kind, [], frozen=True, namespace={"__module__": where})
        monkeypatch.setattr(library, kind, made, raising=False)
    rewritten(path, lambda values, _: values.update(more={"$class": name, "fields": fields}))
    before = set(sys.modules)
    assert read_checkpoint(path)["more"] == UnknownSettings(name, fields)
    assert set(sys.modules) == before


def test_a_library_that_is_made_for_this_package_may_bring_settings(path: Path, monkeypatch) -> None:
    library = types.ModuleType("library")
    library.__file__ = "/somewhere/site-packages/library.py"
    library.Own = make_dataclass("Own", [], frozen=True, namespace={"__module__": "library"})  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "library", library)
    rewritten(path, lambda values, _: values.update(more={"$class": "library:Own", "fields": {}}))
    assert read_checkpoint(path)["more"] == UnknownSettings("library:Own", {})
    library.RewardSettings = RewardSettings  # type: ignore[attr-defined]
    assert read_checkpoint(path)["more"] == library.Own()


def test_settings_that_assert_are_refused_in_one_sentence(path: Path) -> None:
    name = f"{Strict.__module__}:Strict"
    rewritten(path, lambda values, _: values.update(more={"$class": name, "fields": {"weight": -1.0}}))
    with pytest.raises(SprintlabError, match="refuses its fields: no weight") as refusal:
        read_checkpoint(path)
    assert "\n" not in str(refusal.value)


def test_modules_are_not_imported_for_a_stranger(path: Path, tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "trap.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n")
    monkeypatch.syspath_prepend(str(tmp_path))

    def change(values, _header):
        values["settings"]["fields"]["rewards"] = {"$class": "trap:Rewards", "fields": {}}

    rewritten(path, change)
    assert unknown_settings(read_checkpoint(path)["settings"]) == ["trap:Rewards"]
    assert not (tmp_path / "ran").exists() and "trap" not in sys.modules


def test_a_module_of_the_package_is_not_imported_for_a_stranger(path: Path, monkeypatch) -> None:
    """Some take ten seconds, or ask the GPU's driver what there is."""
    monkeypatch.delitem(sys.modules, "sprintlab.api.doctor", raising=False)
    rewritten(path, lambda values, _: values.update(more={"$class": "sprintlab.api.doctor:X", "fields": {}}))
    read_checkpoint(path)
    assert "sprintlab.api.doctor" not in sys.modules


@pytest.mark.parametrize(
    "change",
    [
        lambda v, h: v["settings"]["fields"]["ppo"]["fields"].update(hidden={"$tuple": [10**9]}),
        lambda v, h: v["settings"]["fields"].update(unheard_of=1),
        lambda v, h: v["settings"]["fields"]["ppo"]["fields"].update(epochs=5.5),
        lambda v, h: v["settings"]["fields"]["ppo"]["fields"].update(entropy="much"),
        lambda v, h: v.update(settings=3),
        lambda v, h: v["progress"].update(log=[{"reward": "x"}]),
        lambda v, h: v["progress"].update(log=3),
        lambda v, h: v["progress"].update(environment_steps=2**64 - 1),  # one more is never read again
        lambda v, h: v["progress"].update(iteration=-(10**18)),
        lambda v, h: v["progress"].update(iteration=1.5),
        lambda v, h: v.pop("learner"),
        lambda v, h: h["state.learner.actor.0.weight"].update(shape=[10**6, 10**6]),
        lambda v, h: h["state.learner.actor.0.weight"].update(data_offsets=[0, 2**60]),
        lambda v, h: h["state.learner.actor.0.weight"].update(dtype="object"),
        lambda v, h: h.pop("state.learner.actor.0.weight"),
        lambda v, h: v["generators"]["numpy"]["$tuple"][1].update(dtype="O"),
        lambda v, h: v["generators"]["numpy"]["$tuple"][1].update(dtype="f8,("),
        lambda v, h: v.update(more=[{"$tensor": "state.learner.actor.count"}] * 2),
        lambda v, h: v.update(more=[0] * 2_500_000),
        lambda v, h: v.update(more=[v["settings"]] * 1001),  # a million of them took half a minute
    ],
)
def test_values_that_no_run_writes(path: Path, change) -> None:
    rewritten(path, change)
    with pytest.raises(SprintlabError) as refusal:
        read_checkpoint(path)
    assert "\n" not in str(refusal.value)


def refused(path: Path, change, match: str) -> None:
    rewritten(path, change)
    with pytest.raises(SprintlabError, match=match) as refusal:
        read_checkpoint(path)
    assert "\n" not in str(refusal.value)


def test_tensors_that_share_bytes_are_refused_before_one_is_made(path: Path, monkeypatch) -> None:
    """A thousand tensors of a megabyte each would fit into a file of one megabyte."""

    def change(values, header):
        end = max(entry["data_offsets"][1] for name, entry in header.items() if name[0] != "_")
        for number in range(1000):
            header[f"more.{number}"] = {"dtype": "U8", "shape": [end], "data_offsets": [0, end]}
        values["more"] = [{"$tensor": f"more.{number}"} for number in range(1000)]

    monkeypatch.setattr(module, "_tensor", lambda *_: pytest.fail("a tensor was made"))
    refused(path, change, "overlap")


@pytest.mark.parametrize(
    "offsets", [[8, 0], [-8, 0], [0, 2**40], [0.5, 1], ["0", "1"], [0], 3, None, [0, 1, 2]]
)
def test_places_that_no_tensor_has_are_refused(path: Path, offsets) -> None:
    def change(_, header):
        header["more"] = {"dtype": "U8", "shape": [1], "data_offsets": offsets}

    refused(path, change, "damaged")


@pytest.mark.parametrize(
    "more",
    [{"more": [0] * 3}, {"shape": [1] * 17}, {"shape": [[0] * 3]}, {"shape": [True]}, {"shape": [1.0]}],
)
def test_a_table_that_says_more_than_a_table_does_is_refused_before_the_values_are_read(
    path: Path, more, monkeypatch
) -> None:
    """Four million numbers in the table and as many among the values took 24 s."""

    def change(_, header):
        header["more"] = {"dtype": "U8", "shape": [1], "data_offsets": [0, 1], **more}

    rewritten(path, change)
    read = []
    monkeypatch.setattr(module, "parse_json", lambda text: read.append(text) or parse_json(text))
    with pytest.raises(SprintlabError, match="no table of tensors"):
        read_checkpoint(path)
    assert len(read) == 1


@pytest.mark.parametrize("kind", ["float64", "uint8", "int64", "uint16"])
def test_an_array_is_of_the_kind_that_is_kept(path: Path, kind: str) -> None:
    """Bytes read as numbers of eight bytes are eight times as many."""

    def change(values, header):
        header["more"] = {"dtype": "I8", "shape": [0], "data_offsets": [0, 0]}
        values["more"] = {"$array": "more", "dtype": kind}

    refused(path, change, "not kept as what it is")


def test_values_are_counted_however_their_commas_are_written(path: Path, monkeypatch) -> None:
    rewritten(path, lambda values, header: values.update(more=[0] * 5000))
    content, comma = path.read_bytes(), b"\\u002c"
    (length,) = struct.unpack_from("<Q", content)
    header = json.loads(content[8 : 8 + length])
    header["__metadata__"]["sha256"] = "0" * 64
    text = json.dumps(header).encode().replace(b"0, 0", b"0" + comma + b"0")
    whole = struct.pack("<Q", len(text)) + text + content[8 + length :]
    path.write_bytes(whole.replace(b"0" * 64, module._checksum(whole).encode(), 1))
    assert len(read_checkpoint(path)["more"]) == 5000
    monkeypatch.setattr(module, "_MOST_VALUES", 4000)
    with pytest.raises(SprintlabError, match="more than 4000 values"):
        read_checkpoint(path)


def test_what_stands_beside_the_values_is_counted_before_it_is_read(path: Path, monkeypatch) -> None:
    monkeypatch.setattr(module, "_MOST_VALUES", 4000)
    read_checkpoint(path)
    rewritten(path, lambda values, header: header.update(more=[0] * 5000))
    with pytest.raises(SprintlabError, match="more than 4000 values"):
        read_checkpoint(path)


def test_lists_and_objects_within_others_count_as_values(path: Path, monkeypatch) -> None:
    rewritten(path, lambda values, _: values.update(more=[{"a": [{}]}] * 1000))
    assert len(read_checkpoint(path)["more"]) == 1000
    monkeypatch.setattr(module, "_MOST_VALUES", 3500)
    with pytest.raises(SprintlabError, match="more than 3500 values"):
        read_checkpoint(path)


def test_the_longest_run_writes_what_is_read_again(path: Path) -> None:
    row = {f"value {number}": 0.5 for number in range(70)}  # a few more than there are
    rewritten(path, lambda values, _: values["progress"].update(log=[row] * MOST_ITERATIONS))
    assert len(read_checkpoint(path)["progress"].log) == MOST_ITERATIONS
    with pytest.raises(InvalidValueError, match="iterations = 30001"):
        TrainOptions(iterations=MOST_ITERATIONS + 1)


def test_a_module_that_imports_others_when_asked_is_not_asked(path: Path, monkeypatch) -> None:
    lazy = types.ModuleType("lazy")
    lazy.__getattr__ = lambda name: pytest.fail("a stranger had something imported")  # type: ignore[method-assign]
    monkeypatch.setitem(sys.modules, "lazy", lazy)
    rewritten(path, lambda values, _: values.update(more={"$class": "lazy:heavy", "fields": {}}))
    assert read_checkpoint(path)["more"] == UnknownSettings("lazy:heavy", {})


def test_a_name_that_is_too_long_for_a_disk_is_refused() -> None:
    with pytest.raises(SprintlabError, match="no such file"):
        read_checkpoint(Path("c" * 300))


def test_another_version_is_named(path: Path) -> None:
    rewritten(path, lambda v, h: h["__metadata__"].update(format="5"))
    with pytest.raises(SprintlabError, match="format 5; this version reads 4"):
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

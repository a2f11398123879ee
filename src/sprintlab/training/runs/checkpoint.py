"""Checkpoints: tensors and JSON in one file with a checksum. Reading one runs nothing that stands in it.

The file is a safetensors file: eight bytes with the length of the header, a header of JSON, then the tensors'
bytes. ``__metadata__`` holds the format's version, all values that are no tensors as JSON, and a SHA-256 of
the whole file, written with zeros in its place. Settings are written as the import path of their class and
their fields: a class is looked up where it is imported already, as this package's settings always are.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import struct
import sys
import sysconfig
import types
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from sprintlab.core.errors import SprintlabError, printable
from sprintlab.core.files import atomic_write_bytes
from sprintlab.core.reading import parse_json, read_bytes
from sprintlab.robots import RobotDescription, robot_fingerprint

if TYPE_CHECKING:
    import torch

CHECKPOINT_FORMAT = 4
CHECKPOINT_LIMIT = 1 << 30
"""Largest checkpoint that is read [bytes]; those of this package have some ten million."""
_HEADER_LIMIT = 128 << 20
_MOST_VALUES = 2_500_000
MOST_ITERATIONS = 30_000
"""Most iterations of a run: its log holds 64 values of each, and shall be read again."""
_MOST_SETTINGS = 1000  # a run has some twenty
_MOST_TENSORS = 100_000
_MOST_SIDES, _ENTRIES = 16, 3  # of a tensor; of what the table says of it: type, shape, place
LARGEST_COUNT = 10**15
"""Most iterations or steps that a run has done: it goes on counting, and files keep 64 bits."""
_NAME = "sprintlab checkpoint"
_NO_CHECKSUM = "0" * 64
_DEEPEST = 60
_DAMAGED = (
    LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RuntimeError, MemoryError,
)  # fmt: skip

# Safetensors' names of types, PyTorch's names and the bytes of one number.
_TYPES = {
    "F64": ("float64", 8), "F32": ("float32", 4), "F16": ("float16", 2), "BF16": ("bfloat16", 2),
    "I64": ("int64", 8), "I32": ("int32", 4), "I16": ("int16", 2), "I8": ("int8", 1),
    "U8": ("uint8", 1), "BOOL": ("bool", 1),
}  # fmt: skip
_ARRAY_TYPES = {"bool", "float16", "float32", "float64"} | {
    f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)
}
_NAMES = {torch_name: name for name, (torch_name, _) in _TYPES.items()}


@dataclass
class Progress:
    """What has been done, over all sessions of a run; the policy rests before ``policy_rests_until``."""

    iteration: int = 0
    environment_steps: int = 0
    seconds: float = 0.0
    log: list[dict[str, float]] = field(default_factory=list[dict[str, float]])
    policy_rests_until: int = 0


@dataclass(frozen=True)
class UnknownSettings:
    """Settings whose class is not imported here: enough to export the policy, not to train on.

    Attributes:
        path: module and name of the class.
        values: its fields.
    """

    path: str
    values: Mapping[str, Any]


def write_checkpoint(state: Mapping[str, Any], path: Path) -> None:
    """Write nested dictionaries and lists of tensors, arrays, numbers, texts and settings, in one step.

    Raises:
        SprintlabError: the disk refuses, or a value is nothing of the kind.
    """
    tensors: dict[str, torch.Tensor] = {}
    values = _packed(dict(state), tensors, "state")
    atomic_write_bytes(path, _file(values, tensors))


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Load a checkpoint of ours, on the CPU.

    Raises:
        SprintlabError: missing, truncated, damaged, of another format, or written by something else.
    """
    values, table, content = _opened(path)
    try:
        _check_places(table, len(content))
        state = _unpacked(values, _Parts(table, content))
        _check_state(state)
        state["progress"] = Progress(**state["progress"])
    except SprintlabError as error:
        raise SprintlabError(f"{path} is no usable checkpoint: {error}") from error
    except _DAMAGED as error:
        raise SprintlabError(f"{path} is no checkpoint or is damaged: {printable(error)}") from error
    return state


def check_checkpoint(path: Path) -> set[str]:
    """Names of what a checkpoint holds, without PyTorch: at once.

    Raises:
        SprintlabError: missing, truncated, damaged, of another format, or written by something else.
    """
    values, _, _ = _opened(path)
    return set(cast("dict[str, Any]", values)) if isinstance(values, dict) else set()


def unknown_settings(settings: object) -> list[str]:
    """Import paths of the classes within some settings that are not imported here."""
    if isinstance(settings, UnknownSettings):
        return [settings.path]
    if not is_dataclass(settings):
        return []
    return [path for item in fields(settings) for path in unknown_settings(getattr(settings, item.name))]


def check_robot(state: Mapping[str, Any], robot: RobotDescription) -> None:
    """Refuse another robot than the one that was trained: a policy would bear its name, and a run mix both.

    Args:
        state: of a checkpoint; those of earlier versions do not tell.
        robot: that its settings name now.

    Raises:
        SprintlabError: its table has changed since.
    """
    if state.get("robot_fingerprint") not in (None, robot_fingerprint(robot)):
        raise SprintlabError(
            f"the table of robot {printable(robot.name, 80)} has changed since it was trained: put the old "
            "one back, or begin a run with the new one (train --start-from)"
        )


# --- the file ---------------------------------------------------------------------------------------------


def _file(values: Any, tensors: Mapping[str, torch.Tensor]) -> bytes:
    header: dict[str, Any] = {
        "__metadata__": {
            "kind": _NAME,
            "format": str(CHECKPOINT_FORMAT),
            "sha256": _NO_CHECKSUM,  # before the values: it is found by its zeros
            "values": json.dumps(values),
        }
    }
    blobs: list[bytes] = []
    end = 0
    for name, tensor in tensors.items():
        kind = _NAMES[str(tensor.dtype).removeprefix("torch.")]
        blobs.append(_bytes_of(tensor))
        header[name] = {
            "dtype": kind,
            "shape": list(tensor.shape),
            "data_offsets": [end, end + len(blobs[-1])],
        }
        end += len(blobs[-1])
    text = json.dumps(header).encode()
    head = text + b" " * (-len(text) % 8)
    content = b"".join((struct.pack("<Q", len(head)), head, *blobs))
    return content.replace(_NO_CHECKSUM.encode(), _checksum(content).encode(), 1)


def _checksum(*parts: bytes | memoryview) -> str:
    made = hashlib.sha256()
    for part in parts:
        made.update(part)
    return made.hexdigest()


def _bytes_of(tensor: torch.Tensor) -> bytes:
    import torch

    plain = tensor.detach().cpu().contiguous().reshape(-1)
    return plain.view(torch.uint8).numpy().tobytes() if plain.numel() else b""


def _opened(path: Path) -> tuple[Any, dict[str, Any], memoryview]:
    """Values, table of the tensors and their bytes, the checksum compared."""
    if not os.path.exists(path):  # unlike Path.exists, it takes a name of any length
        raise SprintlabError(f"{path} is no checkpoint: there is no such file")
    content = read_bytes(path, CHECKPOINT_LIMIT, what="checkpoint")
    if content[:2] in (b"PK", b"\x80\x02"):
        raise SprintlabError(
            f"{path} is no sprintlab checkpoint of format {CHECKPOINT_FORMAT}: files of this kind can run "
            "code and are not opened"
        )
    try:
        (length,) = struct.unpack_from("<Q", content)
        if length > min(_HEADER_LIMIT, len(content) - 8):
            raise ValueError("it is cut off")
        _check_count(content[8 : 8 + length])
        header = parse_json(content[8 : 8 + length])
        about = header.pop("__metadata__")
        if about["kind"] != _NAME:
            raise ValueError("it is of another kind")
        version, told = str(about["format"]), str(about["sha256"])
        _check_count(str(about["values"]).encode())  # in the header its signs may be written as codes
    except (ValueError, KeyError, TypeError, AttributeError, struct.error) as error:
        raise SprintlabError(f"{path} is no checkpoint or is truncated: {printable(error)}") from error
    if version != str(CHECKPOINT_FORMAT):
        raise SprintlabError(
            f"{path} is a checkpoint of format {printable(version, 20)}; this version reads "
            f"{CHECKPOINT_FORMAT}"
        )
    blank = content[: 8 + length].replace(told.encode(), _NO_CHECKSUM.encode(), 1)
    body = memoryview(content)[8 + length :]
    if len(told) != 64 or _checksum(blank, body) != told:
        raise SprintlabError(f"{path} is damaged: its checksum does not fit; take an earlier copy")
    try:
        _check_table(header)
        return parse_json(about["values"]), header, body
    except (ValueError, KeyError, TypeError) as error:
        raise SprintlabError(f"{path} is no checkpoint or is damaged: {printable(error)}") from error


def _check_count(text: bytes) -> None:
    """Refuse more values than are read in ten seconds; lists and objects within others count too."""
    if sum(map(text.count, (b",", b"[", b"{"))) > _MOST_VALUES:
        raise ValueError(f"it holds more than {_MOST_VALUES} values")


def _check_table(table: dict[str, Any]) -> None:
    """Refuse a table of tensors that says more than a table does. Raises ``ValueError`` and others."""
    if len(table) > _MOST_TENSORS:
        raise ValueError(f"it has more than {_MOST_TENSORS} tensors")
    for entry in table.values():
        numbers = (*entry["shape"], *entry["data_offsets"])
        if len(entry) != _ENTRIES or len(numbers) > _MOST_SIDES + 2 or {*map(type, numbers)} != {int}:
            raise ValueError("it has no table of tensors")


# --- values -----------------------------------------------------------------------------------------------


def _packed(value: Any, tensors: dict[str, torch.Tensor], name: str) -> Any:
    """A value as JSON; tensors and arrays go into ``tensors`` under their names."""
    import torch

    if value is None or isinstance(value, bool | str | int):
        return value
    if isinstance(value, float):
        return float(value)
    if isinstance(value, np.generic):
        return _packed(value.item(), tensors, name)
    if isinstance(value, torch.Tensor):
        tensors[name] = value
        return {"$tensor": name}
    if isinstance(value, np.ndarray):
        return _packed_array(cast("np.ndarray[Any, Any]", value), tensors, name)
    if isinstance(value, list | tuple | Mapping):
        return _packed_items(value, tensors, name)
    return _packed_object(value, tensors, name)


def _packed_array(value: np.ndarray[Any, Any], tensors: dict[str, torch.Tensor], name: str) -> Any:
    import torch

    wide = value.astype(np.int64) if value.dtype.kind == "u" and value.dtype.itemsize > 1 else value
    tensors[name] = torch.from_numpy(np.ascontiguousarray(wide).copy())
    return {"$array": name, "dtype": str(value.dtype)}


def _packed_items(value: Any, tensors: dict[str, torch.Tensor], name: str) -> Any:
    if isinstance(value, tuple):
        return {"$tuple": _packed(list(cast("tuple[Any, ...]", value)), tensors, name)}
    if isinstance(value, list):
        items = cast("list[Any]", value)
        return [_packed(item, tensors, f"{name}.{place}") for place, item in enumerate(items)]
    pairs = cast("Mapping[Any, Any]", value)
    for key in pairs:
        if not isinstance(key, str) or key.startswith("$"):
            raise SprintlabError(f"{name} has the key {key!r}, which a checkpoint cannot keep: use texts")
    return {key: _packed(item, tensors, f"{name}.{key}") for key, item in pairs.items()}


def _packed_object(value: Any, tensors: dict[str, torch.Tensor], name: str) -> Any:
    """Settings by the import path of their class; refuses what is nothing of the kind."""
    if isinstance(value, UnknownSettings):
        return {"$class": value.path, "fields": _packed(dict(value.values), tensors, name)}
    if isinstance(value, Progress):
        return _packed(vars(value), tensors, name)
    if is_dataclass(value) and not isinstance(value, type):
        items = {item.name: getattr(value, item.name) for item in fields(value) if item.init}
        path = f"{type(value).__module__}:{type(value).__qualname__}"
        return {"$class": path, "fields": _packed(items, tensors, name)}
    raise SprintlabError(
        f"{name} is of {type(value).__name__}, which a checkpoint cannot keep: use numbers, texts, tuples, "
        "tensors and frozen dataclasses of these"
    )


@dataclass
class _Parts:
    """Of which values are made: the tensors' table and bytes; settings so far."""

    table: dict[str, Any]
    content: memoryview
    settings: int = 0


def _unpacked(value: Any, parts: _Parts, depth: int = 0) -> Any:
    """Inverse of ``_packed``."""
    if depth > _DEEPEST:
        raise ValueError("it is nested too deeply")
    if isinstance(value, list):
        items = cast("list[Any]", value)
        if _plain(items):
            return items
        return [_unpacked(item, parts, depth + 1) for item in items]
    if not isinstance(value, dict):
        return value
    entry = cast("dict[str, Any]", value)
    if "$tensor" in entry:
        return _tensor(entry["$tensor"], parts)
    if "$array" in entry:
        return _array(entry, parts)
    if "$tuple" in entry:
        return tuple(_unpacked(entry["$tuple"], parts, depth + 1))
    if "$class" in entry:
        known = cast("dict[str, Any]", _unpacked(entry["fields"], parts, depth + 1))
        return _settings(str(entry["$class"]), known, parts)
    if _plain(entry.values()):
        return entry
    return {key: _unpacked(item, parts, depth + 1) for key, item in entry.items()}


def _array(entry: dict[str, Any], parts: _Parts) -> Any:
    if entry["dtype"] not in _ARRAY_TYPES:
        raise ValueError("an array is of no number")
    stored, kind = _tensor(entry["$array"], parts).numpy(), np.dtype(entry["dtype"])
    if stored.dtype != kind and (stored.dtype != np.int64 or kind.kind != "u"):
        raise ValueError("an array is not kept as what it is")
    return stored.astype(kind)


def _plain(values: Iterable[Any]) -> bool:
    """Whether in none of the values others stand: of millions of numbers each would take a call."""
    return {list, dict}.isdisjoint(map(type, values))


def _check_places(table: dict[str, Any], size: int) -> None:
    """Refuse tensors that share bytes, of which a small file could hold any number. Raises ``ValueError``."""
    used = 0
    for start, end in sorted(entry["data_offsets"] for entry in table.values()):
        if not used <= start <= end <= size:
            raise ValueError("its tensors overlap, or lie outside of it")
        used = end


def _tensor(name: Any, parts: _Parts) -> torch.Tensor:
    """A tensor by its name, which stands in one place only: a name a million times is no checkpoint."""
    import torch

    entry = parts.table.pop(name)
    torch_name, size = _TYPES[entry["dtype"]]
    shape, (start, end) = entry["shape"], entry["data_offsets"]
    if any(side < 0 for side in shape) or end - start != math.prod(shape) * size:
        raise ValueError(f"the size of tensor {name} is not that of its shape")
    kind = getattr(torch, torch_name)
    if start == end:
        return torch.zeros(shape, dtype=kind)
    return torch.frombuffer(bytearray(parts.content[start:end]), dtype=kind).reshape(shape)


def _settings(path: str, values: dict[str, Any], parts: _Parts) -> Any:
    """Settings of a class by its import path; ``UnknownSettings`` where that is not imported here."""
    from sprintlab.training.settings import without_removed  # and with it all of this package's settings

    parts.settings += 1
    if parts.settings > _MOST_SETTINGS:
        raise ValueError(f"it holds more than {_MOST_SETTINGS} settings")
    module_name, _, name = path.partition(":")
    module: Any = sys.modules.get(module_name)
    found = None if _of_another_library(module) else module
    for part in name.split("."):  # not getattr: some modules import others when they are asked for them
        found = vars(found).get(part) if isinstance(found, type | types.ModuleType) else None
    if not isinstance(found, type) or not is_dataclass(found):
        return UnknownSettings(path, values)
    if not found.__dataclass_params__.frozen or found.__module__ != module_name:  # type: ignore[attr-defined]
        raise ValueError(f"{printable(path, 80)} is no class of settings")
    try:
        return found(**without_removed(found, values))
    except AssertionError as error:  # a class of one's own may check its fields like that
        raise ValueError(f"{printable(path, 80)} refuses its fields: {error}") from error


def _of_another_library(module: object) -> bool:
    """Whether a module is installed beside this package and has nothing of it: no settings come from there.

    Libraries are full of frozen dataclasses, and making one may do anything: one of PyTorch's imports its
    compiler.
    """
    if not isinstance(module, types.ModuleType) or _is_ours(module):
        return False
    place = Path(vars(module).get("__file__") or "")
    installed = not {"site-packages", "dist-packages"}.isdisjoint(place.parts)
    standard = place.is_relative_to(sysconfig.get_path("stdlib"))
    return (installed or standard) and not any(map(_is_ours, list(vars(module).values())))


def _is_ours(value: object) -> bool:
    """Whether a module, class or function is of this package."""
    if not isinstance(value, types.ModuleType | type | types.FunctionType):
        return False
    name = value.__name__ if isinstance(value, types.ModuleType) else value.__module__
    return str(name).partition(".")[0] == "sprintlab"


def _check_state(state: Any) -> None:
    """Refuse values that no run writes. Raises ``ValueError`` and others."""
    from sprintlab.training.settings import TrainingSettings

    if not isinstance(state["settings"], TrainingSettings):
        raise ValueError("it has no settings of a training")
    for name in ("command_line", "device", "date"):
        if not isinstance(state[name], str):
            raise ValueError(f"its {name} is no text")
    if not all(isinstance(version, str) for version in state["versions"].values()):
        raise ValueError("its versions are no texts")
    progress = Progress(**state["progress"])
    counts = (progress.iteration, progress.environment_steps, progress.policy_rests_until)
    if not all(type(count) is int and 0 <= count <= LARGEST_COUNT for count in counts):
        raise ValueError(f"its counts are not whole numbers from 0 to {LARGEST_COUNT}")
    if not all({int, float, bool}.issuperset(map(type, row.values())) for row in progress.log):
        raise ValueError("a value in its log is not a number")
    if not math.isfinite(progress.seconds):
        raise ValueError("its time is no finite number")
    if not isinstance(state["config_hash"], str) or not isinstance(state["learner"]["actor"], dict):
        raise ValueError("it has no policy")

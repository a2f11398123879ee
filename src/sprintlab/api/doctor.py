"""``doctor``: what works here, and what to do about the rest."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

from sprintlab.api.results import Progress, Result, records, silent, styled
from sprintlab.core.arguments import checked
from sprintlab.core.extras import keep_compiled_code_private, package_version
from sprintlab.core.interpreters import new_interpreter
from sprintlab.evaluation import video

LEAST_DISK = 1e9
"""Free space that a training run with its checkpoints and logs should find [bytes]."""
_PROBE_SECONDS = 120.0
_COLOURS = {"ok": "green", "missing": "yellow", "broken": "red", "not tried": "dim"}
_CUDA = """
import torch
x = torch.zeros(8, device="cuda:0")
graph, stream = torch.cuda.CUDAGraph(), torch.cuda.Stream()
with torch.cuda.stream(stream):
    x.add_(1)
torch.cuda.synchronize()
with torch.cuda.graph(graph):
    x.add_(1)
graph.replay()
torch.cuda.synchronize()
assert x.tolist() == [2.0] * 8
print(torch.cuda.get_device_name(0))
"""
_COMPILE = """
import torch
device = "cuda:0" if torch.cuda.is_available() else "cpu"
function = torch.compile(lambda x: (x * 2 + 1).sum())
assert float(function(torch.ones(64, device=device))) == 192.0
print(f"compiled and run on {device}")
"""
_COMPILERS = ("gcc", "clang", "cc")
Outcome = tuple[str, str, str]
"""State, what was found, and advice. Missing: not here, and not needed by everybody; broken: unusable."""


@checked
def doctor(
    *,
    folder: Path | str = Path("."),
    thorough: bool = False,
    training: bool = False,
    progress: Progress = silent,
) -> Result:
    """Try out what sprintlab needs: packages, GPU, compiler, OpenGL, disk.

    The status is 1 where something is broken; what is merely not installed is no fault.
    Example: sprintlab doctor --training

    Args:
        folder: whose disk runs are to be written to.
        thorough: also try CUDA, compilation and rendering: half a minute and more.
        training: the same, and count what training on a GPU does not find as a fault.
    """
    findings = list(_findings(Path(folder), thorough or training, progress))
    wanted = [item for item in findings if training and item["needed_for"].startswith("training")]
    faults = [item for item in findings if item["state"] == "broken"]
    faults += [item for item in wanted if item["state"] == "missing"]
    rows = [{"what": item["name"], **item, "state": _coloured(item["state"])} for item in findings]
    shown = [{key: row[key] for key in ("what", "state", "found", "needed_for")} for row in rows]
    advised: dict[str, list[str]] = {}
    for item in findings:
        if item["advice"]:
            advised.setdefault(item["advice"], []).append(item["name"])
    advice = [f"{', '.join(names)}: {text}" for text, names in advised.items()]
    return Result(
        numbers={"ok": not faults, "findings": findings},
        shown=[records("sprintlab doctor", shown), *advice],
        status=1 if faults else 0,
    )


def _coloured(state: str) -> Any:
    return styled(f"[{_COLOURS[state]}]{state}[/]")


def _finding(name: str, needed_for: str, outcome: Outcome) -> dict[str, str]:
    return {
        "name": name,
        "needed_for": needed_for,
        **dict(zip(("state", "found", "advice"), outcome, strict=True)),
    }


def _findings(folder: Path, thorough: bool, progress: Progress) -> Iterator[dict[str, str]]:
    """Every finding, in the order in which one depends on another."""
    yield _finding("Python", "everything", ("ok", platform.python_version(), ""))
    yield _finding("platform", "everything", ("ok", platform.platform(), ""))
    yield from package_findings()
    for name, needed_for, attempt, slow in (
        ("GPU driver", "training on a GPU", _driver, False),
        ("CUDA", "training on a GPU", _cuda, True),
        ("C compiler", "training at full speed (torch.compile)", _compiler, False),
        ("torch.compile", "training at full speed", _compilation, True),
        ("OpenGL backend", "videos", _opengl, True),
        ("disk", "runs", lambda: room_at(folder), False),
    ):
        progress(name, None)
        tried = (
            attempt() if thorough or not slow else ("not tried", "", "sprintlab doctor --thorough tries it")
        )
        yield _finding(name, needed_for, tried)


def package_findings() -> Iterator[dict[str, str]]:
    """Every package that sprintlab or one of its extras asks for, against the range that it asks for."""
    yield _finding("sprintlab", "everything", ("ok", package_version("sprintlab"), ""))
    try:
        asked = [(_extra(text), Requirement(text)) for text in metadata.requires("sprintlab") or []]
    except metadata.PackageNotFoundError:  # it runs from a source tree
        asked = []
    seen = {"sprintlab"}
    # What several extras bring is named for the commonest use: the base first, then training.
    for extra, wanted in sorted(asked, key=lambda pair: pair[0] not in ("", "train")):
        applies = wanted.marker is None or wanted.marker.evaluate({"extra": extra})
        if applies and extra not in ("dev", "docs") and wanted.name not in seen:
            seen.add(wanted.name)
            use = {"": "everything", "train": "training"}.get(extra, f"the extra {extra}")
            yield _finding(wanted.name, use, package_outcome(wanted, extra))


def _extra(requirement: str) -> str:
    """Name of the extra that a requirement belongs to; empty for those that are always needed."""
    match = re.search(r"extra\s*==\s*['\"]([^'\"]+)['\"]", requirement)
    return match.group(1) if match else ""


def package_outcome(wanted: Requirement, extra: str) -> Outcome:
    """Whether a package is installed in a version that is asked for; ``extra`` brings it, or is empty."""
    try:
        found = metadata.version(wanted.name)
    except metadata.PackageNotFoundError:
        advice = f"pip install 'sprintlab[{extra}]'" if extra else f"pip install '{wanted.name}'"
        return "missing" if extra else "broken", "not installed", advice
    if wanted.specifier.contains(found, prereleases=True):
        return "ok", found, ""
    advice = f"pip install '{wanted.name}{wanted.specifier}'"
    return "broken", f"{found}, wanted {wanted.specifier}", advice


def _probe(code: str) -> tuple[bool, str]:
    """Whether code runs in a process of its own, where it may crash or hang, and the last line it prints."""
    command = [*new_interpreter(), "-c", code]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PROBE_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return False, f"no answer in {_PROBE_SECONDS:.0f} s"
    lines = (done.stderr if done.returncode else done.stdout).strip().splitlines()
    return done.returncode == 0, lines[-1].strip()[:200] if lines else f"exit status {done.returncode}"


def _driver() -> Outcome:
    if shutil.which("nvidia-smi") is None:
        advice = "install NVIDIA's driver (580 or newer for CUDA 13), or train on the CPU, slowly"
        return "missing", "no nvidia-smi", advice
    query = ["nvidia-smi", "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader"]
    done = subprocess.run(query, capture_output=True, text=True, check=False)
    if done.returncode:
        found = (done.stdout + done.stderr).strip().splitlines()[-1:] or ["it fails"]
        return "broken", found[0], "nvidia-smi must list the GPU: reinstall the driver, or reboot"
    return "ok", "; ".join(done.stdout.strip().splitlines()), ""


def _installed(package: str) -> bool:
    try:
        return bool(metadata.version(package))
    except metadata.PackageNotFoundError:
        return False


def _cuda() -> Outcome:
    if not _installed("torch"):
        return _NO_PYTORCH
    devices = (Path("/dev/nvidiactl"), Path("/dev/nvhost-gpu"), Path("/dev/dxg"))
    if shutil.which("nvidia-smi") is None and not any(device.exists() for device in devices):
        return "missing", "no GPU", "needs a GPU and its driver, see above"
    works, said = _probe(_CUDA)
    advice = "install the PyTorch build for your driver's CUDA (pytorch.org/get-started)"
    return ("ok", said, "") if works else ("broken", said, advice)


def _compiler() -> Outcome:
    name = os.environ.get("CC") or next(filter(shutil.which, _COMPILERS), "gcc, clang or cc")
    if shutil.which(name) is None:
        return "missing", f"no {name}", "install one, e.g. apt install gcc, or train with --no-fused"
    done = subprocess.run([name, "--version"], capture_output=True, text=True, check=False)
    return "ok", (done.stdout.splitlines() or [name])[0], ""


def _compilation() -> Outcome:
    if not _installed("torch"):
        return _NO_PYTORCH
    keep_compiled_code_private()
    works, said = _probe(_COMPILE)
    advice = "needs a C compiler, Python's headers (apt install python3-dev) and on a GPU Triton"
    state = "missing" if _compiler()[0] == "missing" else "broken"
    return ("ok", said, "") if works else (state, said, advice)


def _opengl() -> Outcome:
    if backend := video.working_gl_backend():
        return "ok", backend, ""
    advice = "install one, e.g. apt install libegl1 libosmesa6; everything but videos works without"
    return "missing", "none renders", advice


def room_at(folder: Path) -> Outcome:
    """Free space where runs are to be written, and whether they may be."""
    place = folder.absolute()
    while not place.exists():
        place = place.parent
    if not place.is_dir():
        return "broken", f"{place} is a file", "choose a folder"
    if not os.access(place, os.W_OK):
        advice = "choose another folder with --output, or change its permissions"
        return "broken", f"{place} is read-only", advice
    free = shutil.disk_usage(place).free
    advice = f"make room: a run wants {LEAST_DISK / 1e9:.0f} GB" if free < LEAST_DISK else ""
    return "broken" if advice else "ok", f"{free / 1e9:.1f} GB free at {place}", advice


_NO_PYTORCH: Outcome = ("missing", "no PyTorch", "pip install 'sprintlab[train]'")

"""``doctor``: what works here, and what to do about the rest."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from sprintlab.api.results import Progress, Result, silent, styled, table
from sprintlab.core.arguments import checked
from sprintlab.core.extras import keep_compiled_code_private, package_version
from sprintlab.core.interpreters import new_interpreter

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
PACKAGES = {
    "": "numpy mujoco onnxruntime matplotlib", "train": "torch tensorboard", "drake": "drake",
    "play": "viser", "log": "mcap", "unitree": "cyclonedds", "video": "imageio-ffmpeg", "wandb": "wandb",
    "rsl-rl": "rsl-rl-lib", "mjlab": "mjlab",
}  # fmt: skip
"""The packages that matter, by the extra that brings them."""
Outcome = tuple[str, str, str]
"""State, what was found, and advice. Missing: not here, and not needed by everybody; broken: unusable."""


class Finding(NamedTuple):
    """One thing that was tried."""

    name: str
    needed_for: str
    state: str  # ok, missing, broken or not tried
    found: str
    advice: str


@checked
def doctor(*, training: bool = False, progress: Progress = silent) -> Result:
    """Try out what sprintlab needs: packages, GPU, compiler, disk.

    The status is 1 where something is broken; a package that is merely not installed is no fault.
    Example: sprintlab doctor --training

    Args:
        training: also try CUDA and compilation; the status is 1 also where training on a GPU lacks something.
    """
    findings = list(_findings(training, progress))
    faults = [
        item
        for item in findings
        if item.state == "broken"
        or (training and item.state == "missing" and item.needed_for.startswith("training"))
    ]
    ok = not faults
    rows = (
        (item.name, styled(f"[{_COLOURS[item.state]}]{item.state}[/]"), item.found, item.needed_for)
        for item in findings
    )
    advised: dict[str, list[str]] = {}
    for item in findings:
        if item.advice:
            advised.setdefault(item.advice, []).append(item.name)
    advice = [f"{', '.join(names)}: {text}" for text, names in advised.items()]
    return Result(
        numbers={"ok": ok, "findings": [item._asdict() for item in findings]},
        shown=[table("sprintlab doctor", "what", "state", "found", "for", rows=rows), *advice],
        status=0 if ok else 1,
    )


def _findings(training: bool, progress: Progress) -> Iterator[Finding]:
    """Every finding, in the order in which one depends on another."""
    yield Finding("Python", "everything", "ok", platform.python_version(), "")
    yield Finding("platform", "everything", "ok", platform.platform(), "")
    yield Finding("sprintlab", "everything", "ok", package_version("sprintlab"), "")
    for extra, names in PACKAGES.items():
        use = {"": "everything", "train": "training"}.get(extra, f"the extra {extra}")
        yield from (Finding(name, use, *package_outcome(name, extra)) for name in names.split())
    for name, needed_for, attempt, slow in (
        ("GPU driver", "training on a GPU", _driver, False),
        ("CUDA", "training on a GPU", _cuda, True),
        ("C compiler", "training at full speed (torch.compile)", _compiler, False),
        ("torch.compile", "training at full speed", _compilation, True),
        ("disk", "runs", lambda: room_at(Path("runs")), False),
    ):
        progress(name, None)
        tried = (
            attempt() if training or not slow else ("not tried", "", "sprintlab doctor --training tries it")
        )
        yield Finding(name, needed_for, *tried)


def package_outcome(name: str, extra: str) -> Outcome:
    """Whether a package is installed that an extra brings, or without extra the package itself."""
    try:
        return "ok", metadata.version(name), ""
    except metadata.PackageNotFoundError:
        advice = f"pip install 'sprintlab[{extra}]'" if extra else f"pip install {name}"
        return "missing" if extra else "broken", "not installed", advice


def _probe(code: str, advice: str) -> Outcome:
    """Run code in a process of its own, where it may crash or hang; found is the last line that it prints."""
    if package_outcome("torch", "train")[0] != "ok":
        return "missing", "no PyTorch", "pip install 'sprintlab[train]'"
    command = [*new_interpreter(), "-c", code]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PROBE_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return "broken", f"no answer in {_PROBE_SECONDS:.0f} s", advice
    lines = (done.stderr if done.returncode else done.stdout).strip().splitlines()
    said = lines[-1].strip()[:200] if lines else f"exit status {done.returncode}"
    return ("broken", said, advice) if done.returncode else ("ok", said, "")


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


def _cuda() -> Outcome:
    if _driver()[0] != "ok":
        return "missing", "no GPU", "needs a GPU and its driver, see above"
    return _probe(_CUDA, "install the PyTorch build for your driver's CUDA (pytorch.org/get-started)")


def _compiler() -> Outcome:
    name = os.environ.get("CC") or next(filter(shutil.which, _COMPILERS), "gcc, clang or cc")
    if shutil.which(name) is None:
        return "missing", f"no {name}", "install one, e.g. apt install gcc, or train with --no-fused"
    done = subprocess.run([name, "--version"], capture_output=True, text=True, check=False)
    return "ok", (done.stdout.splitlines() or [name])[0], ""


def _compilation() -> Outcome:
    if _compiler()[0] == "missing":
        return "missing", "no C compiler", "needs one, see above"
    keep_compiled_code_private()
    return _probe(_COMPILE, "needs Python's headers (apt install python3-dev) and on a GPU Triton")


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
    advice = f"make room: a training needs {LEAST_DISK / 1e9:.0f} GB" if free < LEAST_DISK else ""
    return "broken" if advice else "ok", f"{free / 1e9:.1f} GB free at {place}", advice

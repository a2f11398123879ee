"""What works here, and what to do about the rest."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from sprintlab.core.extras import package_version

State = Literal["ok", "missing", "broken", "not tried"]
LEAST_DISK = 1e9
"""Free space that a training run with its checkpoints and logs should find [bytes]."""
_PROBE_SECONDS = 120.0
_CAPTURE = """
import torch
x = torch.zeros(8, device="cuda:0")
stream = torch.cuda.Stream()
with torch.cuda.stream(stream):
    x.add_(1)
torch.cuda.synchronize()
graph = torch.cuda.CUDAGraph()
with torch.cuda.graph(graph):
    x.add_(1)
graph.replay()
torch.cuda.synchronize()
assert x.tolist() == [2.0] * 8
"""
_COMPILE = """
import sys, torch
device = sys.argv[1]
function = torch.compile(lambda x: (x * 2 + 1).sum())
assert float(function(torch.ones(64, device=device))) == 192.0
"""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        name: of the thing.
        state: ``ok``; ``missing``: not here, and not needed by everybody; ``broken``: here, but unusable;
            ``not tried``: it would take long, see ``--thorough``.
        found: version, number, or what went wrong.
        needed_for: what does not work without it.
        advice: what to do; empty where it is ok.
    """

    name: str
    state: State
    found: str
    needed_for: str
    advice: str = ""


def examine(
    folder: Path, begin: Callable[[str], None] = lambda name: None, thorough: bool = False
) -> Iterator[Finding]:
    """Every finding, in the order in which one depends on another.

    Args:
        folder: whose disk is looked at.
        begin: called with the name of what is looked at next.
        thorough: also try what takes long.
    """
    yield Finding(name="Python", state="ok", found=platform.python_version(), needed_for="everything")
    yield Finding(name="platform", state="ok", found=platform.platform(), needed_for="everything")
    yield from package_findings()
    checks: tuple[Callable[[], Finding], ...] = (
        _driver, _cuda, _graph_capture, _compiler, _compilation, _onnxruntime, _opengl,
    )  # fmt: skip
    for check in checks:
        name = (check.__doc__ or "").rstrip(".")
        begin(name)
        tried = thorough or check not in _SLOW
        yield check() if tried else _untried(name, _SLOW[check])
    yield disk(folder)


def _untried(name: str, use: str) -> Finding:
    advice = "sprintlab doctor --thorough tries it"
    return Finding(name=name, state="not tried", found="", needed_for=use, advice=advice)


# --- packages --------------------------------------------------------------------------------------------


def package_findings() -> Iterator[Finding]:
    """Every package that sprintlab or one of its extras asks for, against the range that it asks for."""
    from packaging.requirements import Requirement

    yield Finding(name="sprintlab", state="ok", found=package_version("sprintlab"), needed_for="everything")
    seen: set[str] = set()
    # What several extras bring is named for the commonest use: the base first, then training.
    asked = sorted(_requirements(), key=lambda text: _extra(text) not in ("", "train"))
    for text in asked:
        requirement = Requirement(text)
        extra = _extra(text)
        if extra in ("dev", "docs") or requirement.name in seen or requirement.name == "sprintlab":
            continue
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": extra}):
            continue
        seen.add(requirement.name)
        yield package_finding(requirement.name, str(requirement.specifier), extra)


def _requirements() -> list[str]:
    """What sprintlab asks for; nothing is known of it where it runs from a source tree."""
    try:
        return metadata.requires("sprintlab") or []
    except metadata.PackageNotFoundError:
        return []


def _extra(requirement: str) -> str:
    """Name of the extra that a requirement belongs to; empty for those that are always needed."""
    match = re.search(r"extra\s*==\s*['\"]([^'\"]+)['\"]", requirement)
    return match.group(1) if match else ""


def package_finding(name: str, wanted: str, extra: str) -> Finding:
    """Whether a package is installed in a version that is asked for.

    Args:
        name: of the distribution.
        wanted: versions, e.g. ``>=1.24,<2``.
        extra: of sprintlab that brings it; empty where it is always needed.
    """
    from packaging.specifiers import SpecifierSet

    use = {"": "everything", "train": "training"}.get(extra, f"the extra {extra}")
    command = f"pip install 'sprintlab[{extra}]'" if extra else f"pip install '{name}{wanted}'"
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        state: State = "missing" if extra else "broken"
        return Finding(name=name, state=state, found="not installed", needed_for=use, advice=command)
    if not SpecifierSet(wanted).contains(version, prereleases=True):
        found = f"{version}, wanted {wanted}"
        return Finding(
            name=name, state="broken", found=found, needed_for=use, advice=f"pip install '{name}{wanted}'"
        )
    return Finding(name=name, state="ok", found=version, needed_for=use)


def _installed(package: str) -> bool:
    try:
        metadata.version(package)
    except metadata.PackageNotFoundError:
        return False
    return True


# --- what must be tried ----------------------------------------------------------------------------------


def _probe(code: str, *arguments: str) -> str | None:
    """What went wrong with Python code, ``None`` if nothing; in its own process: it may crash or hang."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments],
            capture_output=True, text=True, timeout=_PROBE_SECONDS, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"no answer in {_PROBE_SECONDS:.0f} s"
    if done.returncode == 0:
        return None
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    return lines[-1].strip()[:200] if lines else f"exit status {done.returncode}"


def _driver() -> Finding:
    """GPU driver."""
    use = "training on a GPU"
    if shutil.which("nvidia-smi") is None:
        advice = "install NVIDIA's driver (580 or newer for CUDA 13), or train on the CPU, slowly"
        return Finding(
            name="GPU driver", state="missing", found="no nvidia-smi", needed_for=use, advice=advice
        )
    query = ["nvidia-smi", "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader"]
    done = subprocess.run(query, capture_output=True, text=True, check=False)
    if done.returncode:
        found = (done.stdout + done.stderr).strip().splitlines()[-1:] or ["it fails"]
        advice = "nvidia-smi must list the GPU: reinstall the driver, or reboot after an upgrade"
        return Finding(name="GPU driver", state="broken", found=found[0], needed_for=use, advice=advice)
    return Finding(
        name="GPU driver", state="ok", found="; ".join(done.stdout.strip().splitlines()), needed_for=use
    )


def _has_gpu() -> bool:
    """Whether anything here looks like a GPU of NVIDIA's: its tool, its device file, or that of WSL."""
    devices = (Path("/dev/nvidiactl"), Path("/dev/nvhost-gpu"), Path("/dev/dxg"))
    return shutil.which("nvidia-smi") is not None or any(device.exists() for device in devices)


def _cuda() -> Finding:
    """CUDA in PyTorch."""
    use = "training on a GPU"
    if not _installed("torch"):
        advice = "pip install 'sprintlab[train]'"
        return Finding(name="CUDA", state="missing", found="no PyTorch", needed_for=use, advice=advice)
    if not _has_gpu():
        advice = "needs a GPU and its driver, see above"
        return Finding(name="CUDA", state="missing", found="no GPU", needed_for=use, advice=advice)
    wrong = _probe("import torch; torch.zeros(1, device='cuda:0').add_(1)")
    if wrong is not None:
        advice = "install the PyTorch build for your driver's CUDA (pytorch.org/get-started)"
        return Finding(name="CUDA", state="broken", found=wrong, needed_for=use, advice=advice)
    version = _output("import torch; print(torch.version.cuda, torch.cuda.get_device_name(0))")
    return Finding(name="CUDA", state="ok", found=version, needed_for=use)


def _output(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    return done.stdout.strip()


def _has_cuda() -> bool:
    return (
        _installed("torch")
        and _has_gpu()
        and _probe("import torch; assert torch.cuda.is_available()") is None
    )


def _graph_capture() -> Finding:
    """Capture of a CUDA graph."""
    use = "training at full speed"
    if not _has_cuda():
        return Finding(
            name="graph capture", state="missing", found="not tried without CUDA", needed_for=use,
            advice="needs CUDA, see above",
        )  # fmt: skip
    wrong = _probe(_CAPTURE)
    if wrong is None:
        return Finding(name="graph capture", state="ok", found="captured and replayed", needed_for=use)
    advice = "update driver and PyTorch; until then train with --no-fused, several times slower"
    return Finding(name="graph capture", state="broken", found=wrong, needed_for=use, advice=advice)


def _compiler() -> Finding:
    """C compiler."""
    name = os.environ.get("CC") or next((each for each in ("gcc", "clang", "cc") if shutil.which(each)), None)
    use = "training at full speed (torch.compile)"
    if name is None or shutil.which(name) is None:
        advice = "install one, e.g. apt install gcc, or train with --no-fused"
        return Finding(
            name="C compiler", state="missing", found=f"no {name or 'gcc, clang or cc'}", needed_for=use,
            advice=advice,
        )  # fmt: skip
    done = subprocess.run([name, "--version"], capture_output=True, text=True, check=False)
    return Finding(
        name="C compiler", state="ok", found=(done.stdout.splitlines() or [name])[0], needed_for=use
    )


def _compilation() -> Finding:
    """torch.compile."""
    use = "training at full speed"
    if not _installed("torch"):
        return Finding(
            name="torch.compile", state="missing", found="no PyTorch", needed_for=use,
            advice="pip install 'sprintlab[train]'",
        )  # fmt: skip
    device = "cuda:0" if _has_cuda() else "cpu"
    wrong = _probe(_COMPILE, device)
    if wrong is None:
        triton = f"Triton {metadata.version('triton')}, " if _installed("triton") else ""
        return Finding(
            name="torch.compile", state="ok", found=f"{triton}compiled and run on {device}", needed_for=use
        )
    state: State = "missing" if _compiler().state == "missing" else "broken"
    advice = "needs a C compiler, Python's headers (apt install python3-dev) and on a GPU Triton"
    return Finding(name="torch.compile", state=state, found=wrong, needed_for=use, advice=advice)


def _onnxruntime() -> Finding:
    """ONNX Runtime."""
    try:
        import onnxruntime
    except ImportError as error:
        return Finding(
            name="ONNX Runtime", state="broken", found=str(error), needed_for="running policies",
            advice="pip install --upgrade onnxruntime",
        )  # fmt: skip
    providers = ", ".join(onnxruntime.get_available_providers())
    return Finding(name="ONNX Runtime", state="ok", found=providers, needed_for="running policies")


def _opengl() -> Finding:
    """OpenGL backend."""
    from sprintlab.evaluation.video import working_gl_backend

    backend = working_gl_backend()
    if backend is not None:
        return Finding(name="OpenGL backend", state="ok", found=backend, needed_for="videos")
    advice = "install one, e.g. apt install libegl1 libosmesa6; everything but videos works without"
    return Finding(
        name="OpenGL backend", state="missing", found="none renders", needed_for="videos", advice=advice
    )


def disk(folder: Path) -> Finding:
    """Free space where runs are to be written, and whether they may be."""
    place = folder.absolute()
    while not place.exists():
        place = place.parent
    if not place.is_dir():
        return Finding(
            name="disk", state="broken", found=f"{place} is a file", needed_for="runs",
            advice="choose a folder",
        )  # fmt: skip
    free = shutil.disk_usage(place).free
    found = f"{free / 1e9:.1f} GB free at {place}"
    if not os.access(place, os.W_OK):
        advice = "choose another folder with --output, or change its permissions"
        return Finding(
            name="disk", state="broken", found=f"{place} is read-only", needed_for="runs", advice=advice
        )
    if free < LEAST_DISK:
        advice = f"make room: a run wants {LEAST_DISK / 1e9:.0f} GB"
        return Finding(name="disk", state="broken", found=found, needed_for="runs", advice=advice)
    return Finding(name="disk", state="ok", found=found, needed_for="runs")


_SLOW = {
    _cuda: "training on a GPU",
    _graph_capture: "training at full speed",
    _compilation: "training at full speed",
    _opengl: "videos",
}
"""What takes long to try, and what it is needed for."""

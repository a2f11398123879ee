"""``doctor``: what works here, and what to do about the rest."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from sprintlab.api.results import Progress, Result, silent, styled, table
from sprintlab.core.arguments import checked
from sprintlab.core.extras import keep_compiled_code_private, package_version
from sprintlab.core.interpreters import new_interpreter

State = Literal["ok", "missing", "broken", "not tried"]
LEAST_DISK = 1e9
"""Free space that a training run with its checkpoints and logs should find [bytes]."""
_PROBE_SECONDS = 120.0
_COLOURS = {"ok": "green", "missing": "yellow", "broken": "red", "not tried": "dim"}
_CUDA = "import torch; torch.zeros(1, device='cuda:0').add_(1); print(torch.cuda.get_device_name(0))"
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
print("captured and replayed")
"""
_COMPILE = """
import torch
device = "cuda:0" if torch.cuda.is_available() else "cpu"
function = torch.compile(lambda x: (x * 2 + 1).sum())
assert float(function(torch.ones(64, device=device))) == 192.0
print(f"compiled and run on {device}")
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


@checked
def doctor(
    *,
    folder: Path | str = Path("."),
    thorough: bool = False,
    training: bool = False,
    progress: Progress = silent,
) -> Result:
    """Try out what sprintlab needs: packages, GPU, graph capture, compiler, OpenGL, disk.

    Exit status 1 where something is broken, 0 otherwise: what is merely not installed is no fault. With
    --training it is 1 too where training on a GPU is not possible.

    What takes long (importing PyTorch, compiling, rendering) is tried with --thorough or --training only.

    Args:
        folder: whose disk runs are to be written to.
        thorough: also try CUDA, graph capture, compilation and rendering: half a minute and more.
        training: also count what GPU training needs and does not find as a fault.
        progress: called with the name of what is looked at.
    """
    findings = list(_findings(Path(folder), thorough or training, progress))
    faults = [
        item for item in findings
        if item.state == "broken"
        or (training and item.state == "missing" and item.needed_for.startswith("training"))
    ]  # fmt: skip
    rows = (
        (item.name, styled(f"[{_COLOURS[item.state]}]{item.state}[/]"), item.found, item.needed_for)
        for item in findings
    )
    advised: dict[str, list[str]] = {}
    for item in findings:
        if item.advice:
            advised.setdefault(item.advice, []).append(item.name)
    return Result(
        numbers={"ok": not faults, "findings": [asdict(item) for item in findings]},
        shown=[
            table("sprintlab doctor", "what", "state", "found", "for", rows=rows),
            *(f"{', '.join(names)}: {advice}" for advice, names in advised.items()),
        ],
        found=findings,
        status=1 if faults else 0,
    )


def _findings(folder: Path, thorough: bool, progress: Progress) -> Iterator[Finding]:
    """Every finding, in the order in which one depends on another."""
    yield Finding(name="Python", state="ok", found=platform.python_version(), needed_for="everything")
    yield Finding(name="platform", state="ok", found=platform.platform(), needed_for="everything")
    yield from package_findings()
    for name, needed_for, attempt, slow in (
        ("GPU driver", "training on a GPU", _driver, False),
        ("CUDA", "training on a GPU", _cuda, True),
        ("graph capture", "training at full speed", _graph_capture, True),
        ("C compiler", "training at full speed (torch.compile)", _compiler, False),
        ("torch.compile", "training at full speed", _compilation, True),
        ("ONNX Runtime", "running policies", _onnxruntime, False),
        ("OpenGL backend", "videos", _opengl, True),
        ("disk", "runs", lambda: room_at(folder), False),
    ):
        progress(name, None)
        tried = (
            attempt() if thorough or not slow else ("not tried", "", "sprintlab doctor --thorough tries it")
        )
        yield Finding(name=name, needed_for=needed_for, **dict(zip(_OUTCOME, tried, strict=True)))  # pyright: ignore[reportArgumentType]


Outcome = tuple[State, str, str]
_OUTCOME = ("state", "found", "advice")


def package_findings() -> Iterator[Finding]:
    """Every package that sprintlab or one of its extras asks for, against the range that it asks for."""
    from packaging.requirements import Requirement

    yield Finding(name="sprintlab", state="ok", found=package_version("sprintlab"), needed_for="everything")
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
            yield package_finding(wanted.name, str(wanted.specifier), extra)


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

    state, found, advice = "ok", "not installed", ""
    try:
        found = metadata.version(name)
        if not SpecifierSet(wanted).contains(found, prereleases=True):
            state, found, advice = "broken", f"{found}, wanted {wanted}", f"pip install '{name}{wanted}'"
    except metadata.PackageNotFoundError:
        state = "missing" if extra else "broken"
        advice = f"pip install 'sprintlab[{extra}]'" if extra else f"pip install '{name}{wanted}'"
    use = {"": "everything", "train": "training"}.get(extra, f"the extra {extra}")
    return Finding(name=name, state=state, found=found, needed_for=use, advice=advice)  # pyright: ignore[reportArgumentType]


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
        advice = "nvidia-smi must list the GPU: reinstall the driver, or reboot after an upgrade"
        return "broken", found[0], advice
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
    if works:
        return "ok", said, ""
    return "broken", said, "install the PyTorch build for your driver's CUDA (pytorch.org/get-started)"


def _graph_capture() -> Outcome:
    if _cuda()[0] != "ok":
        return "missing", "not tried without CUDA", "needs CUDA, see above"
    works, said = _probe(_CAPTURE)
    if works:
        return "ok", said, ""
    return "broken", said, "update driver and PyTorch; until then train with --no-fused, several times slower"


def _compiler() -> Outcome:
    name = os.environ.get("CC") or next((each for each in ("gcc", "clang", "cc") if shutil.which(each)), None)
    if name is None or shutil.which(name) is None:
        advice = "install one, e.g. apt install gcc, or train with --no-fused"
        return "missing", f"no {name or 'gcc, clang or cc'}", advice
    done = subprocess.run([name, "--version"], capture_output=True, text=True, check=False)
    return "ok", (done.stdout.splitlines() or [name])[0], ""


def _compilation() -> Outcome:
    if not _installed("torch"):
        return _NO_PYTORCH
    keep_compiled_code_private()
    works, said = _probe(_COMPILE)
    if works:
        return "ok", said, ""
    advice = "needs a C compiler, Python's headers (apt install python3-dev) and on a GPU Triton"
    return "missing" if _compiler()[0] == "missing" else "broken", said, advice


def _onnxruntime() -> Outcome:
    try:
        from sprintlab.control.onnx_runtime import onnxruntime
    except ImportError as error:
        return "broken", str(error), "pip install --upgrade onnxruntime"
    return "ok", ", ".join(onnxruntime.get_available_providers()), ""


def _opengl() -> Outcome:
    from sprintlab.evaluation.video import working_gl_backend

    if backend := working_gl_backend():
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
    full = free < LEAST_DISK
    advice = f"make room: a run wants {LEAST_DISK / 1e9:.0f} GB" if full else ""
    return "broken" if full else "ok", f"{free / 1e9:.1f} GB free at {place}", advice


_NO_PYTORCH: Outcome = ("missing", "no PyTorch", "pip install 'sprintlab[train]'")

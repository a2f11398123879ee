"""What works here, and what to do about the rest."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, NamedTuple

from rich.console import RenderableType

from sprintlab.api.processes import Progress
from sprintlab.api.tables import Printed, plain_table, styled
from sprintlab.core.arguments import checked
from sprintlab.core.extras import keep_compiled_code_private, package_version
from sprintlab.core.interpreters import new_interpreter

State = Literal["ok", "missing", "broken", "not tried"]
LEAST_DISK = 1e9
"""Free space that a training run with its checkpoints and logs should find [bytes]."""
_PROBE_SECONDS = 120.0
_COLOURS = {"ok": "green", "missing": "yellow", "broken": "red", "not tried": "dim"}
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


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Examination(Printed):
    """What works here, and what to do about the rest."""

    findings: tuple[Finding, ...]
    """One per thing that was looked at."""
    training: bool = False
    """Whether what GPU training lacks counts as a fault."""

    @property
    def ok(self) -> bool:
        """Whether nothing is at fault; what is merely not installed is no fault."""
        return not any(map(self._is_fault, self.findings))

    def _is_fault(self, finding: Finding) -> bool:
        lacking = finding.state == "missing" and finding.needed_for.startswith("training")
        return finding.state == "broken" or (self.training and lacking)

    def to_dict(self) -> dict[str, Any]:
        """Whether all is well, and the findings."""
        return {"ok": self.ok, "findings": [asdict(finding) for finding in self.findings]}

    def tables(self) -> Iterator[RenderableType]:
        """The findings, then what to do, each thing once."""
        table = plain_table("sprintlab doctor", "what", "state", "found", "for")
        advised: dict[str, list[str]] = {}
        for finding in self.findings:
            state = styled(f"[{_COLOURS[finding.state]}]{finding.state}[/]")
            table.add_row(finding.name, state, finding.found, finding.needed_for)
            if finding.advice:
                advised.setdefault(finding.advice, []).append(finding.name)
        yield table
        for advice, names in advised.items():
            yield f"{', '.join(names)}: {advice}"


class Outcome(NamedTuple):
    """What trying a thing showed; fields as in ``Finding``."""

    state: State
    found: str
    advice: str = ""


class Check(NamedTuple):
    """A thing that must be tried; ``slow``: it takes long."""

    name: str
    needed_for: str
    attempt: Callable[[], Outcome]
    slow: bool = False


@checked
def doctor(
    folder: Path | str = Path("."),
    *,
    thorough: bool = False,
    training: bool = False,
    progress: Progress = lambda what, share: None,
) -> Examination:
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
    found = examine(Path(folder), lambda name: progress(name, None), thorough or training)
    return Examination(findings=tuple(found), training=training)


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
    untried = Outcome("not tried", "", "sprintlab doctor --thorough tries it")
    for check in CHECKS:
        begin(check.name)
        outcome = check.attempt() if thorough or not check.slow else untried
        yield Finding(name=check.name, needed_for=check.needed_for, **outcome._asdict())
    yield disk(folder)


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
            [*new_interpreter(), "-c", code, *arguments],
            capture_output=True, text=True, timeout=_PROBE_SECONDS, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"no answer in {_PROBE_SECONDS:.0f} s"
    if done.returncode == 0:
        return None
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    return lines[-1].strip()[:200] if lines else f"exit status {done.returncode}"


def _driver() -> Outcome:
    if shutil.which("nvidia-smi") is None:
        advice = "install NVIDIA's driver (580 or newer for CUDA 13), or train on the CPU, slowly"
        return Outcome("missing", "no nvidia-smi", advice)
    query = ["nvidia-smi", "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader"]
    done = subprocess.run(query, capture_output=True, text=True, check=False)
    if done.returncode:
        found = (done.stdout + done.stderr).strip().splitlines()[-1:] or ["it fails"]
        advice = "nvidia-smi must list the GPU: reinstall the driver, or reboot after an upgrade"
        return Outcome("broken", found[0], advice)
    return Outcome("ok", "; ".join(done.stdout.strip().splitlines()))


def _has_gpu() -> bool:
    """Whether anything here looks like a GPU of NVIDIA's: its tool, its device file, or that of WSL."""
    devices = (Path("/dev/nvidiactl"), Path("/dev/nvhost-gpu"), Path("/dev/dxg"))
    return shutil.which("nvidia-smi") is not None or any(device.exists() for device in devices)


def _cuda() -> Outcome:
    if not _installed("torch"):
        return _NO_PYTORCH
    if not _has_gpu():
        return Outcome("missing", "no GPU", "needs a GPU and its driver, see above")
    wrong = _probe("import torch; torch.zeros(1, device='cuda:0').add_(1)")
    if wrong is not None:
        advice = "install the PyTorch build for your driver's CUDA (pytorch.org/get-started)"
        return Outcome("broken", wrong, advice)
    asked = "import torch; print(torch.version.cuda, torch.cuda.get_device_name(0))"
    done = subprocess.run([*new_interpreter(), "-c", asked], capture_output=True, text=True, check=False)
    return Outcome("ok", done.stdout.strip())


def _has_cuda() -> bool:
    return (
        _installed("torch")
        and _has_gpu()
        and _probe("import torch; assert torch.cuda.is_available()") is None
    )


def _graph_capture() -> Outcome:
    if not _has_cuda():
        return Outcome("missing", "not tried without CUDA", "needs CUDA, see above")
    wrong = _probe(_CAPTURE)
    if wrong is None:
        return Outcome("ok", "captured and replayed")
    advice = "update driver and PyTorch; until then train with --no-fused, several times slower"
    return Outcome("broken", wrong, advice)


def _compiler() -> Outcome:
    name = os.environ.get("CC") or next((each for each in ("gcc", "clang", "cc") if shutil.which(each)), None)
    if name is None or shutil.which(name) is None:
        advice = "install one, e.g. apt install gcc, or train with --no-fused"
        return Outcome("missing", f"no {name or 'gcc, clang or cc'}", advice)
    done = subprocess.run([name, "--version"], capture_output=True, text=True, check=False)
    return Outcome("ok", (done.stdout.splitlines() or [name])[0])


def _compilation() -> Outcome:
    if not _installed("torch"):
        return _NO_PYTORCH
    device = "cuda:0" if _has_cuda() else "cpu"
    keep_compiled_code_private()
    wrong = _probe(_COMPILE, device)
    if wrong is None:
        triton = f"Triton {metadata.version('triton')}, " if _installed("triton") else ""
        return Outcome("ok", f"{triton}compiled and run on {device}")
    advice = "needs a C compiler, Python's headers (apt install python3-dev) and on a GPU Triton"
    return Outcome("missing" if _compiler().state == "missing" else "broken", wrong, advice)


def _onnxruntime() -> Outcome:
    try:
        from sprintlab.control.onnx_runtime import onnxruntime
    except ImportError as error:
        return Outcome("broken", str(error), "pip install --upgrade onnxruntime")
    return Outcome("ok", ", ".join(onnxruntime.get_available_providers()))


def _opengl() -> Outcome:
    from sprintlab.evaluation.video import working_gl_backend

    backend = working_gl_backend()
    if backend is not None:
        return Outcome("ok", backend)
    advice = "install one, e.g. apt install libegl1 libosmesa6; everything but videos works without"
    return Outcome("missing", "none renders", advice)


def disk(folder: Path) -> Finding:
    """Free space where runs are to be written, and whether they may be."""
    place = folder.absolute()
    while not place.exists():
        place = place.parent
    return Finding(name="disk", needed_for="runs", **_room_at(place)._asdict())


def _room_at(place: Path) -> Outcome:
    if not place.is_dir():
        return Outcome("broken", f"{place} is a file", "choose a folder")
    if not os.access(place, os.W_OK):
        advice = "choose another folder with --output, or change its permissions"
        return Outcome("broken", f"{place} is read-only", advice)
    free = shutil.disk_usage(place).free
    found = f"{free / 1e9:.1f} GB free at {place}"
    if free < LEAST_DISK:
        return Outcome("broken", found, f"make room: a run wants {LEAST_DISK / 1e9:.0f} GB")
    return Outcome("ok", found)


_NO_PYTORCH = Outcome("missing", "no PyTorch", "pip install 'sprintlab[train]'")
CHECKS = (
    Check("GPU driver", "training on a GPU", _driver),
    Check("CUDA", "training on a GPU", _cuda, slow=True),
    Check("graph capture", "training at full speed", _graph_capture, slow=True),
    Check("C compiler", "training at full speed (torch.compile)", _compiler),
    Check("torch.compile", "training at full speed", _compilation, slow=True),
    Check("ONNX Runtime", "running policies", _onnxruntime),
    Check("OpenGL backend", "videos", _opengl, slow=True),
)
"""In the order in which one depends on another."""

"""The CPU backend: the compiler that the machine has, and vectors of eight robots."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from sprintlab.core.errors import SimulationError

COMPILERS = ("g++", "clang++")
_FLAGS = (
    "-O3", "-march=native", "-fPIC", "-shared", "-w", "-std=c++17", "-fno-math-errno", "-fno-trapping-math",
    "-ffinite-math-only", "-fno-signed-zeros", "-freciprocal-math", "-ffp-contract=fast",
)  # fmt: skip
"""Not ``-ffast-math``: a library linked with it sets subnormal numbers to zero in the whole process."""


def cache_folder() -> Path:
    """Where compiled engines are kept: ``$XDG_CACHE_HOME/sprintlab/engine``, or below ``~/.cache``."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(home) / "sprintlab" / "engine"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def cached(name: str, content: bytes) -> Path:
    """Write a file into the cache in one go, so that processes side by side never see half of it."""
    path = cache_folder() / name
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
        file.write(content)
    os.replace(file.name, path)
    return path


def compile_library(source: str, double: bool = False, flags: Sequence[str] = ()) -> Path:
    """Compile a translation unit to a shared library; the same source is compiled once.

    Raises:
        SimulationError: there is no compiler, or it refuses the source.
    """
    compiler = next((found for name in COMPILERS if (found := shutil.which(name))), None)
    if compiler is None:
        raise SimulationError(
            "the engine needs a C++ compiler on a CPU: install g++ or clang++ (apt install g++), or use a GPU"
        )
    version = subprocess.run([compiler, "--version"], capture_output=True, check=True).stdout
    flags = [*_FLAGS, *(["-DDOUBLE_PRECISION"] if double else []), *_parallel(compiler), *flags]
    key = hashlib.sha256("\n".join([version.decode(), _processor(), *flags, source]).encode()).hexdigest()[
        :24
    ]
    path = cache_folder() / f"{key}.so"
    if not path.exists():
        with tempfile.TemporaryDirectory() as folder:
            unit, made = Path(folder) / "engine.cpp", Path(folder) / "engine.so"
            unit.write_text(source, encoding="utf-8")
            command = [compiler, *flags, "-o", str(made), str(unit)]
            result = subprocess.run(command, capture_output=True, text=True, check=False)
            if result.returncode:
                raise SimulationError(f"{compiler} does not compile the engine: {result.stderr[-1500:]}")
            cached(path.name, made.read_bytes())
    return path


def _parallel(compiler: str) -> Sequence[str]:
    return ("-fopenmp",) if compiler.endswith("g++") and "clang" not in compiler else ()


def _processor() -> str:
    """What ``-march=native`` depends on: the instructions that this processor knows."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return ""
    return next((line for line in lines if line.startswith("flags")), "")


class CpuKernel:
    """One policy step of all robots, on the calling thread and OpenMP's others."""

    def __init__(self, source: str, double: bool = False) -> None:
        self._library = ctypes.CDLL(str(compile_library(source, double)))

    def bind(self, buffers: ctypes.Structure, robots: int) -> None:
        """Keep what every launch passes."""
        self._arguments = (ctypes.byref(buffers), ctypes.c_int(robots))

    def launch(self) -> None:
        """Step."""
        self._library.engine_step(*self._arguments)

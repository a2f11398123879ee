"""The NVIDIA backend: NVRTC, which PyTorch's wheels bring along, and the driver; nothing else is needed.

Both are called through ctypes: ``libnvrtc`` compiles the source to a cubin, which is kept in the cache,
and ``cuLaunchKernel`` starts it on PyTorch's current stream, where CUDA graphs can capture it.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
from pathlib import Path
from typing import Any

import torch

from sprintlab.core.errors import SimulationError
from sprintlab.engine.cpu import cache_folder, cached

THREADS = 64
"""Per block: sixteen robots. The compiler may then use 255 registers per thread, and hardly spills."""
_LEGS = 4
_OPTIONS = ("--std=c++17", "--use_fast_math", f"-DTHREADS={THREADS}")
_REGISTERS, _LOCAL_BYTES = 4, 3  # CU_FUNC_ATTRIBUTE_NUM_REGS, _LOCAL_SIZE_BYTES


def _nvrtc() -> ctypes.CDLL:
    """The library: one already found by the system's loader, or the one beside PyTorch."""
    major = int((torch.version.cuda or "13").split(".")[0])
    names = [f"libnvrtc.so.{major}"]
    spec = importlib.util.find_spec("nvidia")
    for root in (spec.submodule_search_locations or []) if spec else []:
        names += map(str, sorted(Path(root).glob(f"**/lib/libnvrtc.so.{major}*")))
    for name in names:
        try:
            return ctypes.CDLL(name)
        except OSError:
            continue
    raise SimulationError(
        "the engine found no NVRTC: install PyTorch with CUDA, pip install 'sprintlab[train]'"
    )


def compile_cubin(source: str, architecture: str) -> Path:
    """Compile a translation unit for ``sm_90`` and so on; the same source is compiled once.

    Raises:
        SimulationError: there is no compiler, or it refuses the source.
    """
    library, options = _nvrtc(), [*_OPTIONS, f"--gpu-architecture={architecture}"]
    version = (ctypes.c_int * 2)()
    library.nvrtcVersion(ctypes.byref(version), ctypes.byref(version, 4))
    key = hashlib.sha256("\n".join([str(list(version)), *options, source]).encode()).hexdigest()[:24]
    path = cache_folder() / f"{key}.cubin"
    return path if path.exists() else cached(path.name, _compiled(library, source, options))


def _compiled(library: ctypes.CDLL, source: str, options: list[str]) -> bytes:
    program, size = ctypes.c_void_p(), ctypes.c_size_t()
    library.nvrtcCreateProgram(ctypes.byref(program), source.encode(), b"engine.cu", 0, None, None)
    arguments = (ctypes.c_char_p * len(options))(*(option.encode() for option in options))
    failed = library.nvrtcCompileProgram(program, len(options), arguments)
    get_size, get = (
        ("nvrtcGetProgramLogSize", "nvrtcGetProgramLog") if failed else ("nvrtcGetCUBINSize", "nvrtcGetCUBIN")
    )
    getattr(library, get_size)(program, ctypes.byref(size))
    result = ctypes.create_string_buffer(size.value)
    getattr(library, get)(program, result)
    library.nvrtcDestroyProgram(ctypes.byref(program))
    if failed:
        raise SimulationError(f"NVRTC does not compile the engine: {result.value.decode()[:1500]}")
    return result.raw


class CudaKernel:
    """One policy step of all robots on a GPU, four threads per robot.

    Attributes:
        registers: registers of one thread; ``local_bytes`` of it that do not fit.
    """

    def __init__(self, source: str, device: str) -> None:
        self._device = torch.device(device)
        torch.zeros(1, device=self._device)  # makes PyTorch's context current
        self._driver = ctypes.CDLL("libcuda.so.1")
        major, minor = torch.cuda.get_device_capability(self._device)
        image = compile_cubin(source, f"sm_{major}{minor}").read_bytes()
        self._module, self._function = ctypes.c_void_p(), ctypes.c_void_p()
        with torch.cuda.device(self._device):
            self._call("cuModuleLoadData", ctypes.byref(self._module), image)
            self._call("cuModuleGetFunction", ctypes.byref(self._function), self._module, b"engine_step")
            self.registers, self.local_bytes = self._attribute(_REGISTERS), self._attribute(_LOCAL_BYTES)

    def _call(self, name: str, *arguments: Any) -> None:
        code = getattr(self._driver, name)(*arguments)
        if code:
            raise SimulationError(f"the engine's kernel does not run: {name} returned CUDA error {code}")

    def _attribute(self, number: int) -> int:
        """An attribute of the kernel; asking for it also loads the code, which a capture could not."""
        value = ctypes.c_int()
        self._call("cuFuncGetAttribute", ctypes.byref(value), number, self._function)
        return value.value

    def bind(self, buffers: ctypes.Structure, robots: int) -> None:
        """Keep what every launch passes."""
        self._values = (buffers, ctypes.c_int(robots))
        pointers = [ctypes.cast(ctypes.pointer(value), ctypes.c_void_p) for value in self._values]
        self._arguments = (ctypes.c_void_p * 2)(*pointers)
        self._blocks = (robots * _LEGS + THREADS - 1) // THREADS

    def launch(self) -> None:
        """Step, on PyTorch's current stream, without waiting."""
        stream = ctypes.c_void_p(torch.cuda.current_stream(self._device).cuda_stream)
        grid = (self._blocks, 1, 1, THREADS, 1, 1)
        with torch.cuda.device(self._device):  # the kernel belongs to its GPU's context
            self._call("cuLaunchKernel", self._function, *grid, 0, stream, self._arguments, None)

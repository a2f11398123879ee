"""The CUDA source without a GPU: compiled by NVRTC, and run on a CPU with threads as lanes of a warp."""

from __future__ import annotations

import ctypes

import pytest
import torch
from tests.engine.test_engine import OUTPUTS, options, scattered

from sprintlab.core.errors import SimulationError
from sprintlab.engine import Engine
from sprintlab.engine.cpu import compile_library
from sprintlab.engine.cuda import compile_cubin
from sprintlab.engine.source import source
from sprintlab.robots import load_robot

_BEFORE = """
#include <barrier>
#include <cmath>
#include <thread>
#include <vector>
#define __device__
#define __global__
#define __forceinline__ inline
#define __constant__
#define __launch_bounds__(a, b)
#define EMULATED
#define THREADS 64
static struct { int x; } blockDim = { 4 };
static thread_local struct { int x; } blockIdx, threadIdx;
static std::barrier<> lanes(4);
static float box[4];
static float passed(float value, int from) {
  box[threadIdx.x] = value;
  lanes.arrive_and_wait();
  const float result = box[from];
  lanes.arrive_and_wait();
  return result;
}
static float __shfl_xor_sync(unsigned, float value, int other) { return passed(value, threadIdx.x ^ other); }
static float __shfl_sync(unsigned, float value, int from, int) { return passed(value, from); }
static float root(float x) { return sqrtf(x); }
static float reciprocal(float x) { return 1.0f / x; }
static float inverse_root(float x) { return 1.0f / sqrtf(x); }
static float tangent(float x) { return tanhf(x); }
static float two_to_the(float x) { return exp2f(x); }
static float clamp01(float x) { return fminf(fmaxf(x, 0.0f), 1.0f); }
static void sine(float x, float& s, float& c) { s = sinf(x); c = cosf(x); }
"""
_AFTER = """
extern "C" void emulate(const Buffers* buffers, int robots) {
  std::vector<std::thread> threads;
  for (int lane = 0; lane < 4; lane++)
    threads.emplace_back([=] {
      threadIdx.x = lane;
      for (int robot = 0; robot < robots; robot++) { blockIdx.x = robot; engine_step(*buffers, robots); }
    });
  for (auto& thread : threads) thread.join();
}
"""


class _Emulated:
    def __init__(self, text: str) -> None:
        self._library = ctypes.CDLL(
            str(compile_library(_BEFORE + text + _AFTER, flags=("-std=c++20", "-O1")))
        )

    def bind(self, buffers: ctypes.Structure, robots: int) -> None:
        self._arguments = (ctypes.byref(buffers), ctypes.c_int(robots))

    def launch(self) -> None:
        self._library.emulate(*self._arguments)


@pytest.mark.parametrize("name", ["bp2", "bp2-waist", "go2"])
def test_four_threads_a_robot_compute_what_the_vectors_do(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, chosen = load_robot(name), options(3, 10)
    plain = Engine(robot, chosen, "cpu")
    monkeypatch.setattr(Engine, "_make_kernel", lambda engine, *_: _Emulated(source(engine.model, "cuda")))
    emulated = Engine(robot, chosen, "cpu")
    for engine in (plain, emulated):
        scattered(engine, 0.4)
        for _ in range(2):
            engine.step()
    for field in (
        *OUTPUTS,
        "torque",
        "stance",
        "pad_deflection",
        "touchdowns",
        "recent_force",
        "limit_share",
    ):
        ours, theirs = getattr(emulated, field), getattr(plain, field)
        assert torch.allclose(ours, theirs, rtol=2e-3, atol=2e-3 * float(theirs.abs().max())), field


def test_nvrtc_compiles_the_source() -> None:
    engine = Engine(load_robot("bp2"), options(8), "cpu")
    try:
        path = compile_cubin(source(engine.model, "cuda"), "sm_90")
    except SimulationError as error:
        if "found no NVRTC" in str(error):
            pytest.skip("PyTorch without CUDA")
        raise
    assert path.stat().st_size > 10_000

"""A mass on the engine's pad: its contact code alone, compiled around a point mass in double precision."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

import numpy as np

from sprintlab.engine.cpu import compile_library

_MASS = """
extern "C" void slide(double mass, double k, double b, double mu, double drag, double step, int steps,
                      double* height, double* v, double* bristle, double* log) {
  Pad pad = { k, b, mu, drag };
  FOOT_MASS_NORMAL = FOOT_MASS_ALONG = mass;
  for (int i = 0; i < steps; i++) {
    Touch touch = press(pad, -*height, v, bristle, step);
    // f - h/2 B a = m a
    double a[3] = { touch.force[0] / (mass + step / 2 * touch.drag),
                    touch.force[1] / (mass + step / 2 * touch.drag),
                    touch.force[2] / (mass + step / 2 * touch.damping) };
    settle(touch, pad, v, a, step, bristle);
    for (int k = 0; k < 3; k++) { v[k] += step * a[k]; log[5 * i + k] = touch.force[k]; }
    *height += step * v[2];
    log[5 * i + 3] = *height;
    log[5 * i + 4] = v[0];
  }
}
"""


@lru_cache
def _library() -> ctypes.CDLL:
    native = files("sprintlab.engine") / "native"
    numbers, contact = ((native / name).read_text() for name in ("cpu_numbers.h", "contact.h"))
    masses = "static double FOOT_MASS_NORMAL, FOOT_MASS_ALONG;\n"
    text = "#define LEGS 4\n" + numbers + masses + contact + _MASS
    return ctypes.CDLL(str(Path(compile_library(text, double=True))))


def slide(
    *,
    mass: float,
    k: float,
    b: float,
    mu: float,
    drag: float,
    step: float,
    velocity: tuple[float, float, float],
    phase: float,
    steps: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Velocity after ``steps``, and of each step: force (3), height and speed along x.

    The mass starts as high as it falls in the share ``phase`` of a step.
    """
    v, bristle = np.array(velocity, dtype=float), np.zeros(2)
    height, log = np.array([phase * step * -velocity[2]]), np.zeros((steps, 5))
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (height, v, bristle, log)]
    numbers = [ctypes.c_double(x) for x in (mass, k, b, mu, drag, step)]
    _library().slide(*numbers, ctypes.c_int(steps), *pointers)
    return v, log

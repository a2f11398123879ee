"""One array namespace for arguments of several kinds: Python numbers, NumPy arrays, PyTorch tensors."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import array_api_compat
import numpy as np

Array: TypeAlias = Any
"""A Python number, a NumPy array, or a tensor of another array-API library."""

_compat: Any = array_api_compat  # its guards are typed by libraries that need not be installed
_NUMPY_KINDS = (int, float, np.ndarray, np.generic)


def as_arrays(*values: Array) -> tuple[Any, list[Array]]:
    """The array-API namespace, and ``values`` in one library, floating type and device, not broadcast.

    A tensor beside NumPy arrays decides.
    """
    for value in values:
        if not isinstance(value, _NUMPY_KINDS) and _compat.is_array_api_obj(value):
            return _as_tensors(value, values)
    return np, _as_numpy(values)


class Floats:
    """What a law asks of an array library, for Python numbers: 0-d arrays take ten times as long."""

    sqrt = staticmethod(math.sqrt)
    abs = staticmethod(abs)

    @staticmethod
    def minimum(first: float, second: float) -> float:
        """As ``numpy.minimum``: NaN where one of them is."""
        return first if first <= second or first != first else second

    @staticmethod
    def maximum(first: float, second: float) -> float:
        """As ``numpy.maximum``: NaN where one of them is."""
        return first if first >= second or first != first else second

    @staticmethod
    def zeros_like(value: float) -> float:
        """Zero."""
        return 0.0

    @staticmethod
    def ones_like(value: float) -> float:
        """One."""
        return 1.0

    @staticmethod
    def where(condition: bool, chosen: float, other: float) -> float:
        """One of two numbers."""
        return chosen if condition else other


def as_values(*values: Array) -> tuple[Any, list[Array]]:
    """As ``as_arrays``, but numbers stay numbers, with ``Floats`` in the place of a library."""
    if all(isinstance(value, (int, float)) for value in values):
        return Floats, [float(value) for value in values]
    return as_arrays(*values)


def _as_numpy(values: tuple[Array, ...]) -> list[Array]:
    """Numbers take the type of the arrays; this is on the path of every simulated millisecond."""
    arrays = [value for value in values if not isinstance(value, (int, float))]
    dtype = np.result_type(np.float32, *arrays) if arrays else np.float64
    return [np.asarray(value, dtype) for value in values]


def _as_tensors(reference: Array, values: tuple[Array, ...]) -> tuple[Any, list[Array]]:
    """Numbers become tensors by a fill: a copy from the host would make the host wait for the device."""
    xp = _compat.array_namespace(reference)
    real = xp.isdtype(reference.dtype, "real floating")
    dtype = reference.dtype if real else xp.asarray(0.0).dtype
    device = getattr(reference, "device", None)  # JAX's traced arrays have none

    def convert(value: Array) -> Array:
        if isinstance(value, int | float):
            return xp.full((), value, dtype=dtype, device=device)
        return xp.asarray(value, dtype=dtype, device=device)

    return xp, [convert(value) for value in values]

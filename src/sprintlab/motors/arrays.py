"""One array namespace for arguments of several kinds: Python numbers, NumPy arrays, PyTorch tensors."""

from __future__ import annotations

from typing import Any, TypeAlias

import array_api_compat
import numpy as np

Array: TypeAlias = Any
"""A Python number, a NumPy array, or a tensor of another array-API library."""

_compat: Any = array_api_compat  # its guards are typed by libraries that need not be installed


def _is_number(value: Array) -> bool:
    return isinstance(value, int | float)


def _reference(values: tuple[Array, ...]) -> Array:
    """The array that decides library, type and device: the first tensor, else the first NumPy array."""
    arrays = [value for value in values if not _is_number(value) and _compat.is_array_api_obj(value)]
    foreign = [value for value in arrays if not _compat.is_numpy_array(value)]
    return (foreign or arrays or [np.zeros(())])[0]


def _floating(xp: Any, reference: Array, values: tuple[Array, ...]) -> Any:
    """The floating type in which to calculate."""
    if _compat.is_numpy_array(reference):
        arrays = [value for value in values if not _is_number(value)]
        return np.result_type(np.float32, *arrays) if arrays else np.float64
    return reference.dtype if xp.isdtype(reference.dtype, "real floating") else xp.asarray(0.0).dtype


def as_arrays(*values: Array) -> tuple[Any, list[Array]]:
    """Bring ``values`` into one library, type and device.

    A tensor beside NumPy arrays decides; numbers become arrays without dimensions by a fill, because a
    copy from the host would make the host wait for the device.

    Args:
        values: numbers or arrays of any broadcastable shapes.

    Returns:
        The array-API namespace and the values as arrays, in order, not broadcast.
    """
    reference = _reference(values)
    xp = _compat.array_namespace(reference)
    dtype = _floating(xp, reference, values)
    device = None if _compat.is_numpy_array(reference) else reference.device

    def convert(value: Array) -> Array:
        if _is_number(value):
            return xp.full((), value, dtype=dtype, device=device)
        return xp.asarray(value, dtype=dtype, device=device)

    return xp, [convert(value) for value in values]

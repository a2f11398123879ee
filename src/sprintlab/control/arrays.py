"""The few array helpers shared by control and commands.

Everything here stays on the device: no host copies, no branches on values, so a caller may capture
it in a CUDA graph. ``array_api_compat``'s own ``minimum`` copies a Python scalar from the host, which a
capture refuses; ``full_like`` makes it on the device.
"""

from __future__ import annotations

from typing import Any, TypeAlias, cast

import array_api_compat
import numpy as np

Array: TypeAlias = Any
"""A NumPy array or a PyTorch tensor."""

_compat: Any = array_api_compat  # its guards are typed by libraries that need not be installed
_NUMPY = _compat.array_namespace(np.empty(0))
_NUMPY_KINDS = (np.ndarray, np.generic)
_PLAIN = (int, float, *_NUMPY_KINDS)


def namespace(*values: Array | float) -> Any:
    """Array API namespace of the arrays among the arguments; NumPy if all are Python scalars."""
    # A controller comes here a hundred times in a policy step, and so does PyTorch where it traces a step of
    # training: to follow the general question takes it a third of that time.
    for value in values:
        if not isinstance(value, _PLAIN):
            return _tensors_namespace(value, values)
    return _NUMPY


def _tensors_namespace(found: Array, values: tuple[Array | float, ...]) -> Any:
    """Namespace of values among which ``found`` is the first that NumPy does not know."""
    if type(found).__module__.startswith("torch"):
        from array_api_compat import torch

        return torch
    return _compat.array_namespace(*(value for value in values if not isinstance(value, (int, float))))


def as_array(value: Array | float) -> Array:
    """``value`` itself, or a 0-d NumPy array if it is a Python scalar."""
    return np.asarray(value, dtype=np.float64) if isinstance(value, (int, float)) else value


def filled(value: Array | float, like: Array) -> Array:
    """A Python scalar in the type of ``like``, on its device, to broadcast with it; an array as it is."""
    if isinstance(like, _NUMPY_KINDS):
        return np.asarray(value, dtype=cast("Any", like).dtype) if isinstance(value, (int, float)) else value
    return namespace(like).full_like(like, value) if isinstance(value, (int, float)) else value


def clip(value: Array, lower: Array | float, upper: Array | float) -> Array:
    """``value`` limited to ``[lower, upper]``, which broadcast against it; NaN stays NaN."""
    xp = namespace(value)
    return xp.minimum(xp.maximum(value, filled(lower, value)), filled(upper, value))


def where_rows(mask: Array, chosen: Array, other: Array) -> Array:
    """Rows of ``chosen`` where ``mask`` ``(n,)`` holds, else of ``other``; both ``(n, ...)``."""
    xp = namespace(mask, chosen, other)
    return xp.where(xp.reshape(mask, mask.shape + (1,) * (chosen.ndim - mask.ndim)), chosen, other)

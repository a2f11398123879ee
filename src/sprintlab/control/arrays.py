"""The few array helpers shared by control and commands.

Everything here stays on the device: no host copies, no branches on values, so a caller may capture
it in a CUDA graph. ``array_api_compat``'s own ``minimum`` copies a Python scalar from the host, which a
capture refuses; ``full_like`` makes it on the device.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import array_api_compat
import numpy as np

Array: TypeAlias = Any
"""A NumPy array or a PyTorch tensor."""


def namespace(*values: Array | float) -> Any:
    """Array API namespace of the arrays among the arguments; NumPy if all are Python scalars."""
    arrays = [value for value in values if not isinstance(value, (int, float))]
    compat: Any = array_api_compat
    return compat.array_namespace(*arrays) if arrays else compat.array_namespace(np.empty(0))


def as_array(value: Array | float) -> Array:
    """``value`` itself, or a 0-d NumPy array if it is a Python scalar."""
    return np.asarray(value, dtype=np.float64) if isinstance(value, (int, float)) else value


def filled(value: Array | float, like: Array) -> Array:
    """A Python scalar as an array like ``like``, made on its device; an array as it is."""
    return namespace(like).full_like(like, value) if isinstance(value, (int, float)) else value


def clip(value: Array, lower: Array | float, upper: Array | float) -> Array:
    """``value`` limited to ``[lower, upper]``, which broadcast against it; NaN stays NaN."""
    xp = namespace(value)
    return xp.minimum(xp.maximum(value, filled(lower, value)), filled(upper, value))


def where_rows(mask: Array, chosen: Array, other: Array) -> Array:
    """Rows of ``chosen`` where ``mask`` ``(n,)`` holds, else of ``other``; both ``(n, ...)``."""
    xp = namespace(mask, chosen, other)
    return xp.where(xp.reshape(mask, mask.shape + (1,) * (chosen.ndim - mask.ndim)), chosen, other)

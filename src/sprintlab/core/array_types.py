"""Types of NumPy arrays that annotations name."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
"""An array of any element type."""
FloatArray = NDArray[np.float64]
"""An array of doubles."""

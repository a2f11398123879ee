"""Types of NumPy arrays that annotations name."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
"""Of any kind of element."""
FloatArray = NDArray[np.float64]
"""Of doubles."""

"""A bench made of arrays, without a file, and what its fit warns of."""

import numpy as np

from sprintlab.workbench.identification import Bench


def bench(current, torque, speed, **others):
    """A bench of these rows, none of them at the limit; the first stands in line 2 of its file."""
    count = len(current)
    return Bench(
        current=current,
        torque=torque,
        speed=speed,
        d_current=np.zeros(count),
        limited=np.zeros(count, dtype=bool),
        lines=np.arange(count) + 2,
        **others,
    )


def said(found, words):
    """Whether a warning of the fit has these words."""
    return any(words in warning for warning in found.warnings)

"""Python's garbage collector, out of the way where much is made and little thrown away."""

from __future__ import annotations

import gc
from collections.abc import Generator
from contextlib import contextmanager


@contextmanager
def suspended_garbage_collection() -> Generator[None]:
    """Keep the collector from running: it takes a quarter of the time in which PyTorch is imported.

    Inside a capture it could also destroy old graphs, which would corrupt the new one.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()

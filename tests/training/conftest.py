"""What all tests of training share."""

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

WITHOUT_TORCH = ("test_scaling.py", "test_sweep.py")
collect_ignore = [
    path.name
    for path in Path(__file__).parent.glob("test_*.py")
    if find_spec("torch") is None and path.name not in WITHOUT_TORCH
]


@pytest.fixture(scope="module", autouse=True)
def short_replay() -> Iterator[None]:
    """A policy is compared over a fifth of a second when it is exported; over all in ``test_export.py``."""
    from sprintlab.training.runs import observed_run

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(observed_run, "_SECONDS", 0.2)
        yield

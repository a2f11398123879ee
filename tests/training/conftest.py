"""What all tests of training share."""

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module", autouse=True)
def short_replay() -> Iterator[None]:
    """A policy is compared over a fifth of a second when it is exported; over all in ``test_export.py``."""
    from sprintlab.training.runs import observed_run

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(observed_run, "_SECONDS", 0.2)
        yield

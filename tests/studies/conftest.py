"""A way to call the study's commands in this process."""

import pytest
from studies.paper.__main__ import main
from tests.calling import caller


@pytest.fixture
def call(capsys):
    """Run ``python -m studies.paper ARGUMENTS`` and return status, stdout and stderr."""
    return caller(main, capsys)

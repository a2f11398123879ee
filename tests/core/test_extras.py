"""A package that an extra brings is asked for in one sentence that names the command."""

import pytest

from sprintlab.core.errors import SprintlabError
from sprintlab.core.extras import require_package


def test_an_installed_package_is_enough():
    require_package("numpy", extra="play", use="this test")


def test_a_missing_package_is_named_with_its_extra():
    with pytest.raises(SprintlabError) as refused:
        require_package("no_such_package", extra="play", use="this test")
    assert "this test needs the package no_such_package" in str(refused.value)
    assert "pip install 'sprintlab[play]'" in str(refused.value)

"""Modules for frameworks that may not be installed here."""

import importlib
import sys

import pytest


@pytest.fixture
def on_guest(monkeypatch):
    """Import a module of ``sprintlab.integrations`` on its framework, or on doubles where that is missing."""

    def load(name, framework, doubles):
        try:
            importlib.import_module(framework)
        except ImportError:
            for each, module in doubles.items():
                monkeypatch.setitem(sys.modules, each, module)
        place = f"sprintlab.integrations.{name}"
        monkeypatch.setitem(sys.modules, place, None)  # gone again after the test
        del sys.modules[place]
        return importlib.import_module(place)

    return load

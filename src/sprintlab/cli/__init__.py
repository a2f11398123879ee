"""The ``sprintlab`` command."""

"""One function a command: its signature the options, its docstring the help.

Every function refuses what cannot work with a ``SprintlabError``, in one sentence and before any work; where
only its files could not be written, the ``found`` of the error is its result. ``options`` says what the
arguments are that mean the same in several functions.
"""

"""Arrays of files: npz archives, read by NumPy without unpickling, and tables of numbers (CSV).

``wanted`` completes the sentence that refuses another file: ``PATH is ...``.
"""

from __future__ import annotations

import os
from collections.abc import Collection

import numpy as np

from sprintlab.core.array_types import Array, FloatArray
from sprintlab.core.errors import SprintlabError
from sprintlab.core.reading import open_regular, read_text

ARCHIVE_LIMIT = 512 << 20
"""Largest archive that is read [bytes]."""
TABLE_LIMIT = 256 << 20
"""Largest CSV that is read [bytes]."""


def read_arrays(
    path: str | os.PathLike[str], names: Collection[str], *, wanted: str = "not an npz archive"
) -> dict[str, Array]:
    """The named arrays of numbers, truth values and texts that an archive has.

    Raises:
        SprintlabError: missing, too large, damaged, or not an archive of arrays.
    """
    with open_regular(path, ARCHIVE_LIMIT, what="archive") as file:
        try:
            found = np.load(file, allow_pickle=False)
            return {name: np.asarray(found[name]) for name in found.files if name in names}
        except Exception as error:  # zipfile, zlib and NumPy raise a dozen kinds for a damaged file
            raise SprintlabError(f"{path} is {wanted}") from error


def read_samples(path: str | os.PathLike[str], names: Collection[str], wanted: str) -> dict[str, FloatArray]:
    """Recorded samples: finite numbers, ``(T,)`` or ``(T, n)``, the same T of at least two in all."""
    found = read_arrays(path, names, wanted=wanted)
    if other := [name for name in names if name not in found or found[name].dtype.kind not in "biuf"]:
        raise SprintlabError(f"{path} is {wanted}: it lacks {', '.join(other)}, or holds text there")
    arrays = {name: found[name].astype(np.float64) for name in names}
    for name, values in arrays.items():
        if values.ndim not in (1, 2) or len(values) != len(next(iter(arrays.values()))) or values.size < 2:
            raise SprintlabError(f"{path} is {wanted}: {name} has shape {values.shape}")
        if not np.isfinite(values).all():
            raise SprintlabError(f"{path} is {wanted}: {name} holds what is not a finite number")
    return arrays


def read_columns(path: str | os.PathLike[str], what: str) -> dict[str, FloatArray]:
    """Columns of a CSV of numbers by their names in its first line."""
    header, *lines = read_text(path, TABLE_LIMIT, what=what).splitlines() or [""]
    names = [name.strip() for name in header.split(",")]
    if len(lines) < 2:
        raise SprintlabError(f"{path} holds no header and two samples")
    try:
        table = np.loadtxt(lines, delimiter=",", ndmin=2)
    except ValueError as error:
        raise SprintlabError(f"{path} is not a table of numbers under one line of names: {error}") from error
    if table.shape[1] != len(names) or len(set(names)) < len(names):
        told = f"{len(names)} names, {len(set(names))} of them different"
        raise SprintlabError(f"{path}: {told}, over {table.shape[1]} columns")
    return dict(zip(names, table.T, strict=True))

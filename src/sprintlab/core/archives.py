"""Arrays of an npz archive, read by NumPy without unpickling.

``wanted`` completes the sentence that refuses another file: ``PATH is ...``.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Collection, Mapping

import numpy as np

from sprintlab.core.array_types import Array, FloatArray
from sprintlab.core.errors import SprintlabError
from sprintlab.core.reading import open_regular

ARCHIVE_LIMIT = 512 << 20
"""Most bytes that an archive, packed or unpacked, may have."""


def read_arrays(
    path: str | os.PathLike[str],
    names: Collection[str] | None = None,
    *,
    wanted: str = "not an npz archive",
    limit: int = ARCHIVE_LIMIT,
) -> dict[str, Array]:
    """The named arrays of numbers, truth values and texts that an archive has; all if ``names`` is ``None``.

    Raises:
        SprintlabError: missing, not an archive of arrays, damaged, or more than ``limit`` bytes.
    """
    with open_regular(path, limit, what="archive") as file:
        try:
            with zipfile.ZipFile(file) as archive:
                sizes = {entry.filename.removesuffix(".npy"): entry.file_size for entry in archive.infolist()}
            taken = [name for name in sizes if names is None or name in names]
            fits = sum(sizes[name] for name in taken) <= limit
            file.seek(0)
            found = np.load(file, allow_pickle=False)
            arrays: dict[str, Array] = {name: np.asarray(found[name]) for name in taken} if fits else {}
        except Exception as error:  # zipfile, zlib and NumPy raise a dozen kinds for a damaged file
            raise SprintlabError(f"{path} is {wanted}") from error
    if not fits:
        raise SprintlabError(f"{path} unpacks to more than {limit >> 20} MB, the most that is read")
    return arrays


def named_floats(
    path: str | os.PathLike[str], found: Mapping[str, Array], names: Collection[str], wanted: str
) -> dict[str, FloatArray]:
    """The named arrays as doubles. Raises ``SprintlabError`` if one is missing or holds texts."""
    if other := [name for name in names if name not in found or found[name].dtype.kind not in "biuf"]:
        raise SprintlabError(f"{path} is {wanted}: it lacks {', '.join(other)}, or holds text there")
    return {name: found[name].astype(np.float64) for name in names}


def read_samples(path: str | os.PathLike[str], names: Collection[str], wanted: str) -> dict[str, FloatArray]:
    """Recorded samples: finite numbers, ``(T,)`` or ``(T, n)``, the same T of at least two in all."""
    arrays = named_floats(path, read_arrays(path, names, wanted=wanted), names, wanted)
    for name, values in arrays.items():
        if values.ndim not in (1, 2) or len(values) != len(next(iter(arrays.values()))) or values.size < 2:
            raise SprintlabError(f"{path} is {wanted}: {name} has shape {values.shape}")
        if not np.isfinite(values).all():
            raise SprintlabError(f"{path} is {wanted}: {name} holds what is not a finite number")
    return arrays

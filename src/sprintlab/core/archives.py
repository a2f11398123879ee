"""Arrays of an npz archive from elsewhere, read by NumPy without unpickling."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Collection, Mapping

import numpy as np
import numpy.typing as npt

from sprintlab.core.array_types import Array
from sprintlab.core.errors import SprintlabError
from sprintlab.core.reading import check_file

ARCHIVE_LIMIT = 512 << 20
"""Most bytes that an archive, packed or unpacked, may have."""


def read_arrays(
    path: str | os.PathLike[str],
    names: Collection[str] | None = None,
    *,
    wanted: str = "not an npz archive",
    limit: int = ARCHIVE_LIMIT,
) -> dict[str, Array]:
    """Arrays of an npz archive by name: numbers, truth values and texts.

    Args:
        path: the file.
        names: which ones; names that the archive lacks are left out of the answer. None for all.
        wanted: completes the sentence that refuses a file of another kind.
        limit: most bytes that the file, and all arrays that are taken from it, may have.

    Raises:
        SprintlabError: missing, not an archive of arrays, damaged, or larger than ``limit``.
    """
    check_file(path, limit, what="archive")
    try:
        with zipfile.ZipFile(path) as archive:
            sizes = {entry.filename.removesuffix(".npy"): entry.file_size for entry in archive.infolist()}
        taken = [name for name in sizes if names is None or name in names]
        if sum(sizes[name] for name in taken) > limit:
            raise SprintlabError(f"{path} unpacks to more than {limit >> 20} MB, the most that is read")
        with np.load(path, allow_pickle=False) as found:
            return {name: np.asarray(found[name]) for name in taken}
    except SprintlabError:
        raise
    except Exception as error:  # zipfile, zlib and NumPy raise a dozen kinds for a damaged file
        raise SprintlabError(f"{path} is {wanted}") from error


def named_floats(
    path: str | os.PathLike[str], found: Mapping[str, Array], names: Collection[str], wanted: str
) -> dict[str, npt.NDArray[np.float64]]:
    """The named arrays as doubles.

    Args:
        path: path of the archive, for the message.
        found: from ``read_arrays``.
        names: names of the arrays.
        wanted: as in ``read_arrays``.

    Raises:
        SprintlabError: one is missing, or holds texts.
    """
    if other := [name for name in names if name not in found or found[name].dtype.kind not in "biuf"]:
        raise SprintlabError(f"{path} is {wanted}: it lacks {', '.join(other)}, or holds text there")
    return {name: found[name].astype(np.float64) for name in names}


def read_samples(
    path: str | os.PathLike[str], names: Collection[str], wanted: str
) -> dict[str, npt.NDArray[np.float64]]:
    """Recorded samples: finite numbers, ``(T,)`` or ``(T, n)``, with the same T of at least two everywhere.

    Args:
        path: the archive.
        names: names of the arrays, all needed.
        wanted: as in ``read_arrays``.

    Raises:
        SprintlabError: as ``read_arrays``, or an array is missing or holds something else.
    """
    arrays = named_floats(path, read_arrays(path, names, wanted=wanted), names, wanted)
    for name, values in arrays.items():
        if values.ndim not in (1, 2) or len(values) != len(next(iter(arrays.values()))) or values.size < 2:
            raise SprintlabError(f"{path} is {wanted}: {name} has shape {values.shape}")
        if not np.isfinite(values).all():
            raise SprintlabError(f"{path} is {wanted}: {name} holds what is not a finite number")
    return arrays

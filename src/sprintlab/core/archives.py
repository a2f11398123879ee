"""Arrays of an npz archive from elsewhere, without NumPy's loader: nothing is unpickled or over-allocated."""

from __future__ import annotations

import io
import math
import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Collection, Mapping

import numpy as np
import numpy.typing as npt

from sprintlab.core.array_types import Array
from sprintlab.core.errors import SprintlabError, printable
from sprintlab.core.reading import read_bytes

ARCHIVE_LIMIT = 512 << 20
"""Most bytes that an archive, packed or unpacked, may have."""
_MOST_NUMBERS = 12_000_000  # in one array, whatever their size: each becomes one of 8 bytes
_MOST_TEXTS = 10_000  # in one array
_MOST_MEMBERS = 10_000
_LARGEST_TABLE = 1 << 20  # bytes that say what the members are
_END, _COUNT, _COUNT_ELSEWHERE = 22, 10, 0xFFFF  # size of a zip file's last record, in it its members' count
_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_DAMAGED = (
    zipfile.BadZipFile, zlib.error, struct.error, EOFError, KeyError, ValueError, TypeError, OverflowError,
    NotImplementedError, RuntimeError, AttributeError, IndexError, SyntaxError, MemoryError, OSError,
    tokenize.TokenError,
)  # fmt: skip


def read_arrays(
    path: str | os.PathLike[str],
    names: Collection[str] | None = None,
    *,
    wanted: str = "no npz archive",
    limit: int = ARCHIVE_LIMIT,
) -> dict[str, Array]:
    """Arrays of an npz archive by name: numbers, truth values and texts.

    Args:
        path: the file.
        names: which ones; those that are not there are left out of the answer. None for all.
        wanted: completes the sentence that refuses a file of another kind.
        limit: most bytes that the file, and all arrays that are taken from it, may have.

    Raises:
        SprintlabError: missing, no regular file, no archive, damaged, larger than ``limit``, with a table of
            contents of more than 1 MB or of other members, or an array of more than twelve million elements.
    """
    content = _Content(read_bytes(path, limit, what="archive"))
    try:
        with zipfile.ZipFile(content) as archive:
            content.opened = True
            members = _members(archive, content)
            found = {entry.filename.removesuffix(".npy"): entry for entry in members}
            taken = {name: entry for name, entry in found.items() if names is None or name in names}
            if any(entry.compress_type not in _PACKINGS for entry in taken.values()):
                raise ValueError("NumPy packs no member like that")
            if sum(entry.file_size for entry in taken.values()) > limit:
                raise SprintlabError(
                    f"{printable(path)} unpacks to more than {limit >> 20} MB, the most that is read"
                )
            return {
                name: _array(_unpacked(archive, entry), f"{name} of {printable(path)}")
                for name, entry in taken.items()
            }
    except _DAMAGED as error:
        raise SprintlabError(f"{printable(path)} is {wanted}") from error


def named_floats(
    path: str | os.PathLike[str], found: Mapping[str, Array], names: Collection[str], wanted: str
) -> dict[str, npt.NDArray[np.float64]]:
    """The named arrays as doubles; what is beyond them is infinite.

    Args:
        path: of the archive, for the sentence.
        found: from ``read_arrays``.
        names: of the arrays.
        wanted: as in ``read_arrays``.

    Raises:
        SprintlabError: one is missing, or holds texts.
    """
    if any(name not in found or found[name].dtype.kind not in "biuf" for name in names):
        raise SprintlabError(f"{printable(path)} is {wanted}")
    with np.errstate(over="ignore"):
        return {name: found[name].astype(np.float64) for name in names}


class _Content(io.BytesIO):
    """Bytes of an archive, whose table of contents ``zipfile`` reads at once, and works on for minutes."""

    opened = False

    def read(self, size: int | None = -1, /) -> bytes:
        """As that of every stream; refuses a long table before one of its entries is looked at."""
        if not self.opened and size is not None and size > _LARGEST_TABLE:
            raise ValueError("its table of contents is too long")
        return super().read(size)


def _members(archive: zipfile.ZipFile, content: _Content) -> list[zipfile.ZipInfo]:
    """What the table of contents lists, if that is what is there.

    No checksum covers the table. A wrong bit in it hides an array, whose absence may mean something: without
    their names, joints bear a robot's. But each name stands beside its member too, and a count at the end.
    """
    members = archive.infolist()
    if len(members) > _MOST_MEMBERS:
        raise ValueError("too many members")
    end = len(content.getbuffer()) - len(archive.comment) - _END
    (count,) = struct.unpack_from("<H", content.getbuffer(), end + _COUNT)
    if count not in (len(members), _COUNT_ELSEWHERE):
        raise ValueError("its table of contents lists other members than it counts")
    for entry in members:
        archive.open(entry).close()  # compares both names
    return members


def _unpacked(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    """Content of a member, no more than it says: read without a size, all that comes is unpacked first."""
    with archive.open(entry) as member:
        return member.read(entry.file_size)


def _array(content: bytes, what: str) -> Array:
    """One member; raises ``ValueError`` and others where it is damaged, ``SprintlabError`` for a long one."""
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        header = np.lib.format.read_array_header_1_0(stream)
    elif version == (2, 0):
        header = np.lib.format.read_array_header_2_0(stream)
    else:
        raise ValueError(f"version {version} is unknown")
    shape, fortran, kind = header
    if kind.kind not in "biufU" or any(size < 0 for size in shape):
        raise ValueError("no numbers and no text")
    start, count = stream.tell(), math.prod(shape)
    if count * kind.itemsize != len(content) - start:
        raise ValueError("its size is not that of its shape")
    if count > (most := _MOST_TEXTS if kind.kind == "U" else _MOST_NUMBERS):
        raise SprintlabError(f"{what} has {count} elements; at most {most} are read")
    codes = f"{kind.byteorder}u4"
    if kind.kind == "U" and _beyond_unicode(np.frombuffer(content, dtype=codes, offset=start)):
        raise ValueError("a text holds code points that Unicode does not have")
    values = (
        np.frombuffer(content, dtype=kind, offset=start) if count * kind.itemsize else np.empty(0, dtype=kind)
    )
    return values.reshape(shape, order="F" if fortran else "C").copy()


def _beyond_unicode(codes: Array) -> bool:
    """Whether some code points are not characters: above U+10FFFF, or surrogates."""
    return bool(((codes > 0x10FFFF) | ((codes >= 0xD800) & (codes < 0xE000))).any())

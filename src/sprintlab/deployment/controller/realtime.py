"""What an operating system can do for a loop that must not be late."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

_ISOLATED = Path("/sys/devices/system/cpu/isolated")
_LOCK_CURRENT, _LOCK_FUTURE = 1, 2  # MCL_CURRENT, MCL_FUTURE


@dataclass(frozen=True, kw_only=True)
class RealTimeGrant:
    """What was granted."""

    memory_locked: bool  # no page of the process can be swapped out
    priority: int | None  # under the real-time scheduler (SCHED_FIFO); None if not permitted or not asked for
    remarks: tuple[str, ...]  # missing privileges in words: refused, or not set up on this machine


@contextmanager
def real_time(priority: int | None, core: int | None = None) -> Iterator[RealTimeGrant]:
    """Lock the memory, raise the priority under SCHED_FIFO (1 to 99), keep the garbage collector out.

    What is not permitted is left out and remarked upon: the loop runs anyway, and counts its misses. At the
    end all is undone.
    """
    if not sys.platform.startswith("linux"):
        yield RealTimeGrant(memory_locked=False, priority=None, remarks=("real time needs Linux",))
        return
    remarks: list[str] = []

    def is_granted(otherwise: str, ask: Callable[[], object]) -> bool:
        try:
            ask()
        except OSError as error:
            remarks.append(f"{otherwise}: {error.strerror}")
            return False
        return True

    cores, scheduler = os.sched_getaffinity(0), (os.sched_getscheduler(0), os.sched_getparam(0))
    if core is not None:
        is_granted(f"the loop cannot stay on core {core}", lambda: os.sched_setaffinity(0, {core}))
    if not os.sched_getaffinity(0) <= _isolated_cores():
        remarks.append("no core is kept free for the loop: isolcpus=N for the kernel, then --core N")
    gc.disable()
    locked, granted = is_granted("memory is not locked (see ulimit -l)", _lock_memory), None
    if priority is None:
        remarks.append("no real-time priority was asked for: every busy process delays the loop")
    else:
        parameters = os.sched_param(priority)
        ask, refused = os.sched_setscheduler, "real-time priority is not permitted (see ulimit -r)"
        granted = priority if is_granted(refused, lambda: ask(0, os.SCHED_FIFO, parameters)) else None
    try:
        yield RealTimeGrant(memory_locked=locked, priority=granted, remarks=tuple(remarks))
    finally:
        os.sched_setaffinity(0, cores)
        with suppress(OSError):  # a lower priority may be taken without permission, not given back
            os.sched_setscheduler(0, *scheduler)
        if locked:
            ctypes.CDLL(None).munlockall()
        gc.enable()


def lacking(priority: int | None, core: int | None = None) -> tuple[str, ...]:
    """What a loop that asks for this would lack here, in words; all granted is undone again."""
    with real_time(priority, core) as grant:
        return grant.remarks


def _isolated_cores() -> set[int]:
    """Cores on which the kernel puts nothing by itself (``isolcpus``)."""
    text = _ISOLATED.read_text(encoding="ascii").strip() if _ISOLATED.is_file() else ""
    ranges = (part.partition("-") for part in text.split(",") if part)
    return {core for first, _, last in ranges for core in range(int(first), int(last or first) + 1)}


def _lock_memory() -> None:
    """Keep all pages in memory; at a limit only those of now: later ones would be refused in mid-run."""
    import resource

    unlimited = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY
    flags = _LOCK_CURRENT | _LOCK_FUTURE if unlimited else _LOCK_CURRENT
    if ctypes.CDLL(None, use_errno=True).mlockall(flags) != 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))

"""Atomic writing on a disk that fails at each possible step."""

import errno
import json
import math
import os
import shutil
import socket
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from sprintlab.core import files
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import (
    atomic_directory,
    atomic_write_bytes,
    atomic_write_json,
    atomic_write_text,
    reserved_directory,
)

FAILING_STEPS = ["fsync", "replace", "chmod"]

DISKS = ["that knows nameless files", "that knows none", "that names none"]


@pytest.fixture(params=DISKS)
def disk(request, monkeypatch):
    """Each disk on which files are written, as far as this system has it."""
    if request.param == "that knows none":
        monkeypatch.delattr(os, "O_TMPFILE", raising=False)
    elif request.param == "that names none":
        monkeypatch.setattr(os, "link", full_disk)


def full_disk(*_args, **_kwargs):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_text_is_written_as_utf8_in_new_folders(tmp_path):
    target = tmp_path / "a" / "b" / "note.txt"
    atomic_write_text(target, "τ ≤ τ_m\n")
    assert target.read_bytes() == "τ ≤ τ_m\n".encode()


@pytest.mark.usefixtures("disk")
def test_existing_file_is_replaced(tmp_path):
    target = tmp_path / "data"
    target.write_bytes(b"old")
    atomic_write_bytes(target, b"new")
    assert target.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.usefixtures("disk")
def test_written_file_may_be_read_by_others(tmp_path):
    atomic_write_bytes(tmp_path / "data", b"x")
    assert (tmp_path / "data").stat().st_mode & 0o777 == 0o644


def test_json_is_read_back(tmp_path):
    atomic_write_json(tmp_path / "x.json", {"speed": 10.5, "falls": [0, 1]})
    assert json.loads((tmp_path / "x.json").read_text()) == {"speed": 10.5, "falls": [0, 1]}


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_json_refuses_what_is_no_number(tmp_path, value):
    with pytest.raises(SprintlabError, match=r"cannot write .*x\.json"):
        atomic_write_json(tmp_path / "x.json", {"speed": value})
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("disk")
@pytest.mark.parametrize("step", FAILING_STEPS)
def test_full_disk_keeps_the_old_file_and_leaves_nothing_behind(tmp_path, monkeypatch, step):
    target = tmp_path / "data"
    target.write_bytes(b"old")
    monkeypatch.setattr(os, step, full_disk)
    with pytest.raises(SprintlabError, match=r"cannot write .*data: No space left on device"):
        atomic_write_bytes(target, b"new")
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.usefixtures("disk")
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limit")
def test_disk_that_fills_while_writing_leaves_nothing_behind(tmp_path):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(SprintlabError, match="File too large"):
            atomic_write_bytes(tmp_path / "data", bytes(5000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())


KILLED_WRITER = """
import os, sys
from sprintlab.core.files import atomic_write_bytes
setattr(os, sys.argv[2], lambda *_, **__: os.kill(os.getpid(), 9))
atomic_write_bytes(sys.argv[1], b"new")
"""


@pytest.mark.skipif(not hasattr(os, "O_TMPFILE"), reason="files without a name are Linux's")
@pytest.mark.parametrize("step", [*FAILING_STEPS, "link"])
def test_a_writer_that_is_killed_leaves_nothing_for_long(tmp_path, step):
    (tmp_path / "data").write_bytes(b"old")
    (tmp_path / ".mine.sprintlab-unfinished").write_text("a file of somebody else")
    (tmp_path / ".01234567.sprintlab-unfinished").symlink_to(tmp_path / "data")
    os.mkfifo(tmp_path / ".89abcdef.sprintlab-unfinished")  # whoever opens it must not wait
    others = set(tmp_path.iterdir())
    killed = subprocess.run([sys.executable, "-c", KILLED_WRITER, str(tmp_path / "data"), step], check=False)
    assert killed.returncode == -9
    assert (tmp_path / "data").read_bytes() == b"old"
    assert len(set(tmp_path.iterdir()) - others) == (step == "replace")
    atomic_write_bytes(tmp_path / "next", b"new")
    assert set(tmp_path.iterdir()) == others | {tmp_path / "next"}


def test_what_a_living_writer_is_about_to_move_is_left_alone(tmp_path, monkeypatch):
    replace = os.replace

    def write_another_first(source, target):
        monkeypatch.undo()
        atomic_write_bytes(tmp_path / "other", b"another")
        replace(source, target)

    monkeypatch.setattr(os, "replace", write_another_first)
    atomic_write_bytes(tmp_path / "data", b"new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "other"]


@pytest.mark.parametrize("write", [atomic_write_bytes, atomic_write_text])
def test_a_name_with_a_zero_byte_is_told_in_one_sentence(tmp_path, write):
    for refuse in (
        lambda path: write(path, b"" if write is atomic_write_bytes else ""),
        files.check_writable,
        files.check_new_folder,
        lambda path: reserved_directory(path).__enter__(),
        lambda path: atomic_directory(path).__enter__(),
    ):
        with pytest.raises(SprintlabError, match=r"a\\x00b: no name holds a zero byte"):
            refuse(tmp_path / "a\0b")
    assert not list(tmp_path.iterdir())


def test_folder_that_is_a_file_is_told_in_one_sentence(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(SprintlabError, match="cannot write"):
        atomic_write_bytes(tmp_path / "file" / "data", b"new")


def pipe(path):
    os.mkfifo(path)


def socket_of(path):
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))


def loop(path):
    path.symlink_to(path.name)


def open_file(path):
    path.symlink_to("/proc/self/fd/1")


def device(path):
    try:
        os.mknod(path, stat.S_IFCHR | 0o600, os.makedev(1, 3))
    except PermissionError:
        pytest.skip("only root makes devices")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have other things that are no files")
@pytest.mark.parametrize("kind", [pipe, socket_of, loop, open_file, device])
def test_what_is_no_file_is_neither_written_nor_replaced(tmp_path, kind):
    """As root, ``--output /dev/null`` would put a file in its place."""
    kind(tmp_path / "out.png")
    before = os.lstat(tmp_path / "out.png")
    for refuse in (
        lambda path: atomic_write_bytes(path, b"new"),
        files.check_writable,
        files.check_writable_file,
        files.check_figure_path,
    ):
        with pytest.raises(SprintlabError, match=r"cannot write .*out\.png"):
            refuse(tmp_path / "out.png")
    assert os.lstat(tmp_path / "out.png") == before
    assert len(list(tmp_path.iterdir())) == 1


def test_places_that_cannot_be_are_refused_before_any_work(tmp_path):
    loop(tmp_path / "loop")
    (tmp_path / "dangling").symlink_to("nowhere")
    for path in ("loop/a/b.json", "dangling/a.json", "a" * 300, "a" * 5000 + "/b"):
        with pytest.raises(SprintlabError, match="cannot write"):
            files.check_writable(tmp_path / path)
    for folder in (tmp_path, "", "."):
        with pytest.raises(SprintlabError, match="it is a folder"):
            files.check_writable_file(folder)


def test_a_link_gives_way_to_the_file_and_what_it_led_to_is_kept(tmp_path):
    (tmp_path / "kept").write_text("old")
    for aim in ("kept", "nowhere"):
        link = tmp_path / f"to-{aim}"
        link.symlink_to(aim)
        files.check_writable_file(link)
        atomic_write_text(link, "new")
        assert link.read_text() == "new" and not link.is_symlink()
    assert (tmp_path / "kept").read_text() == "old" and not (tmp_path / "nowhere").exists()


def test_directory_appears_only_when_complete(tmp_path):
    target = tmp_path / "runs" / "race"
    with atomic_directory(target) as folder:
        (folder / "result.json").write_text("{}")
        assert not target.exists()
    assert [path.name for path in target.iterdir()] == ["result.json"]
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.parametrize("kind", ["folder", "file", "link", "dangling"])
def test_what_somebody_puts_there_while_a_directory_is_filled_is_kept(tmp_path, kind):
    """It was deleted without a word; now both are there, and the sentence says where the new one is."""
    race, kept = tmp_path / "race", tmp_path / "kept"
    expected = pytest.raises(SprintlabError, match=r"something else is at .*race now: .*race-3 is what")
    with expected, atomic_directory(race) as folder:
        (folder / "new").touch()
        (tmp_path / "race-2").touch()
        if kind == "folder":
            race.mkdir()
            (race / "notes").write_text("mine")
        elif kind == "file":
            race.write_text("mine")
        else:
            kept.mkdir(exist_ok=kind == "link")
            race.symlink_to(kept if kind == "link" else "nowhere")
    assert [path.name for path in (tmp_path / "race-3").iterdir()] == ["new"]
    assert os.path.lexists(race) and race.is_symlink() == (kind in ("link", "dangling"))
    assert (
        kind in ("link", "dangling") or (race / "notes" if kind == "folder" else race).read_text() == "mine"
    )
    assert not list(tmp_path.glob(".*"))


def test_what_is_put_into_a_reserved_folder_is_kept(tmp_path):
    with pytest.raises(SprintlabError, match="race-2 is what"), reserved_directory(tmp_path / "race"):
        (tmp_path / "race" / "notes").touch()
        with atomic_directory(tmp_path / "race") as folder:
            (folder / "new").touch()
    assert {path.name for path in tmp_path.rglob("*")} == {"race", "notes", "race-2", "new"}


@pytest.mark.parametrize("failure", [ValueError("broken"), KeyboardInterrupt()])
def test_failed_block_leaves_no_directory_and_keeps_its_error(tmp_path, failure):
    with pytest.raises(type(failure)) as caught, atomic_directory(tmp_path / "race") as folder:
        (folder / "half").touch()
        raise failure
    assert caught.value is failure
    assert not list(tmp_path.iterdir())


def test_failed_block_keeps_the_older_directory(tmp_path):
    target = tmp_path / "race"
    target.mkdir()
    (target / "result.json").write_text("old")
    with pytest.raises(ValueError, match="broken"), atomic_directory(target):
        raise ValueError("broken")
    assert (target / "result.json").read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("step", ["replace", "chmod"])
def test_full_disk_at_the_end_of_a_directory_leaves_nothing_new(tmp_path, monkeypatch, step):
    monkeypatch.setattr(os, step, full_disk)
    with pytest.raises(SprintlabError, match="No space left"), atomic_directory(tmp_path / "race") as folder:
        (folder / "half").touch()
    assert not list(tmp_path.iterdir())


def test_full_disk_inside_the_block_is_told_in_one_sentence(tmp_path):
    with pytest.raises(SprintlabError, match=r"race: No space left"), atomic_directory(tmp_path / "race"):
        full_disk()
    assert not list(tmp_path.iterdir())


def test_error_of_an_inner_write_passes_unchanged(tmp_path):
    with pytest.raises(SprintlabError, match=r"x\.json"), atomic_directory(tmp_path / "race") as folder:
        atomic_write_json(folder / "x.json", math.nan)
    assert not list(Path(tmp_path).iterdir())


def test_only_one_of_two_gets_a_folder(tmp_path):
    with reserved_directory(tmp_path / "race"):
        with pytest.raises(SprintlabError, match="exists already"), reserved_directory(tmp_path / "race"):
            raise AssertionError("the name was given twice")
        with atomic_directory(tmp_path / "race") as folder:
            (folder / "result.json").write_text("{}")
    assert (tmp_path / "race" / "result.json").read_text() == "{}"


def test_a_failure_gives_the_folder_free(tmp_path):
    with pytest.raises(KeyboardInterrupt), reserved_directory(tmp_path / "race"):
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


def test_a_failure_leaves_an_empty_folder_that_was_there_before(tmp_path):
    pytest.importorskip("fcntl")
    (tmp_path / "race").mkdir()
    with pytest.raises(KeyboardInterrupt), reserved_directory(tmp_path / "race"):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == [tmp_path / "race"]


HOLDER = """
import os, sys
from sprintlab.core.files import reserved_directory
with reserved_directory(sys.argv[1]):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_the_name_that_a_killed_process_held_is_free_again(tmp_path):
    pytest.importorskip("fcntl")
    command = [sys.executable, "-c", HOLDER, str(tmp_path / "race")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(SprintlabError, match="exists already"), reserved_directory(tmp_path / "race"):
            pass
        holder.kill()
    with reserved_directory(tmp_path / "race"), atomic_directory(tmp_path / "race") as folder:
        (folder / "result.json").write_text("{}")
    assert (tmp_path / "race" / "result.json").read_text() == "{}"


@pytest.mark.parametrize("kind", ["file", "filled", "link"])
def test_a_name_under_which_something_lies_is_not_free(tmp_path, kind):
    (tmp_path / "empty").mkdir()
    race = tmp_path / "race"
    if kind == "link":
        race.symlink_to("empty")
    else:
        (race if kind == "file" else race / "log").parent.mkdir(exist_ok=True)
        (race if kind == "file" else race / "log").write_text("mine")
    with pytest.raises(SprintlabError, match="exists already"), reserved_directory(race):
        pass
    assert os.path.lexists(race) and (tmp_path / "empty").is_dir()


FILLER = """
import os, sys, time
from sprintlab.core.files import atomic_directory
with atomic_directory(sys.argv[1]) as folder:
    (folder / "half").touch()
    print("filling", flush=True)
    time.sleep(600)
"""


def test_what_a_killed_process_left_is_removed_and_what_a_living_one_fills_is_not(tmp_path):
    pytest.importorskip("fcntl")
    fillers, hidden = [], []
    for name in ("killed", "living"):
        command = [sys.executable, "-c", FILLER, str(tmp_path / name)]
        fillers.append(subprocess.Popen(command, stdout=subprocess.PIPE))
        assert fillers[-1].stdout.readline() == b"filling\n"
        hidden += [path.name for path in tmp_path.iterdir() if path.name not in hidden]
    fillers[0].kill()
    fillers[0].communicate()
    (tmp_path / ".mine.sprintlab-unfinished").write_text("a file")
    with atomic_directory(tmp_path / "next"):
        pass
    left = {path.name for path in tmp_path.iterdir()}
    fillers[1].kill()
    fillers[1].communicate()
    assert left == {hidden[1], ".mine.sprintlab-unfinished", "next"}


def test_a_folder_of_somebody_else_that_is_named_like_an_unfinished_one_is_kept(tmp_path):
    """Even a copy of one that a killed process left: what lies in it is somebody's now."""
    pytest.importorskip("fcntl")
    filler = subprocess.Popen([sys.executable, "-c", FILLER, str(tmp_path / "race")], stdout=subprocess.PIPE)
    assert filler.stdout.readline() == b"filling\n"
    (left,) = tmp_path.iterdir()
    filler.kill()
    filler.communicate()
    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(left, elsewhere / left.name)
    for name in ("mine", "race.abcdefgh", "12ab-01234567"):
        (elsewhere / f".{name}.sprintlab-unfinished").mkdir()
        (elsewhere / f".{name}.sprintlab-unfinished" / "work").write_text("of years")
    os.mkfifo(elsewhere / "pipe")  # whose name tells its own number, too
    number = (elsewhere / "pipe").stat().st_ino
    (elsewhere / "pipe").rename(elsewhere / f".{number:x}-01234567.sprintlab-unfinished")
    before = set(elsewhere.rglob("*"))
    with atomic_directory(elsewhere / "next"):
        pass
    assert set(elsewhere.rglob("*")) == before | {elsewhere / "next"}


@pytest.mark.parametrize("kind", ["folder", "file", "dangling"])
def test_a_name_that_is_taken_is_refused_before_any_work(tmp_path, kind):
    place = tmp_path / "results"
    {"folder": place.mkdir, "file": place.touch, "dangling": lambda: place.symlink_to("nowhere")}[kind]()
    with pytest.raises(SprintlabError, match="exists already"):
        files.check_new_folder(place)


def test_a_text_that_is_none_in_utf8_is_written_with_its_code(tmp_path):
    atomic_write_text(tmp_path / "page.html", "of n\udcff.mcap")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == "of n\\udcff.mcap"

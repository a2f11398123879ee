"""Atomic writing on a disk that fails at each possible step."""

import errno
import json
import math
import os
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


def full_disk(*_args, **_kwargs):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_text_is_written_as_utf8_in_new_folders(tmp_path):
    target = tmp_path / "a" / "b" / "note.txt"
    atomic_write_text(target, "τ ≤ τ_m\n")
    assert target.read_bytes() == "τ ≤ τ_m\n".encode()


def test_existing_file_is_replaced(tmp_path):
    target = tmp_path / "data"
    target.write_bytes(b"old")
    atomic_write_bytes(target, b"new")
    assert target.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [target]


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


@pytest.mark.parametrize("step", FAILING_STEPS)
def test_full_disk_keeps_the_old_file_and_leaves_nothing_behind(tmp_path, monkeypatch, step):
    target = tmp_path / "data"
    target.write_bytes(b"old")
    monkeypatch.setattr(os, step, full_disk)
    with pytest.raises(SprintlabError, match=r"cannot write .*data: No space left on device"):
        atomic_write_bytes(target, b"new")
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


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


def test_folder_that_is_a_file_is_told_in_one_sentence(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(SprintlabError, match="cannot write"):
        atomic_write_bytes(tmp_path / "file" / "data", b"new")


@pytest.mark.skipif(sys.platform == "win32", reason="makes a pipe")
def test_a_pipe_is_neither_written_nor_replaced(tmp_path):
    """As root, ``--output /dev/null`` would put a file in its place."""
    path = tmp_path / "out.png"
    os.mkfifo(path)
    for refuse in (
        lambda path: atomic_write_bytes(path, b"new"),
        files.check_writable,
        files.check_figure_path,
    ):
        with pytest.raises(SprintlabError, match=r"cannot write .*out\.png"):
            refuse(path)
    assert path.is_fifo() and list(tmp_path.iterdir()) == [path]


def test_places_that_cannot_be_are_refused_before_any_work(tmp_path):
    (tmp_path / "dangling").symlink_to("nowhere")
    for path in ("dangling/a.json", "a" * 5000 + "/b"):
        with pytest.raises(SprintlabError, match="cannot write"):
            files.check_writable(tmp_path / path)
    for folder in (tmp_path, "", "."):
        with pytest.raises(SprintlabError, match="it is a folder"):
            files.check_writable_file(folder)


def test_directory_appears_only_when_complete(tmp_path):
    target = tmp_path / "runs" / "race"
    with atomic_directory(target) as folder:
        (folder / "result.json").write_text("{}")
        assert not target.exists()
    assert [path.name for path in target.iterdir()] == ["result.json"]
    assert list(target.parent.iterdir()) == [target]


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


@pytest.mark.parametrize("kind", ["folder", "file", "dangling"])
def test_a_name_that_is_taken_is_refused_before_any_work(tmp_path, kind):
    place = tmp_path / "results"
    {"folder": place.mkdir, "file": place.touch, "dangling": lambda: place.symlink_to("nowhere")}[kind]()
    with pytest.raises(SprintlabError, match="exists already"):
        files.check_new_folder(place)


def test_a_text_that_is_none_in_utf8_is_written_with_its_code(tmp_path):
    atomic_write_text(tmp_path / "page.html", "of n\udcff.mcap")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == "of n\\udcff.mcap"

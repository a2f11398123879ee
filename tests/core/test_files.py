"""Atomic writing on a disk that fails at each possible step."""

import errno
import os

import pytest

from sprintlab.core import files
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_directory, atomic_write_bytes, reserved_directory


def full_disk(*_args, **_kwargs):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("step", ["fsync", "replace", "chmod"])
def test_full_disk_keeps_the_old_file_and_leaves_nothing_behind(tmp_path, monkeypatch, step):
    target = tmp_path / "data"
    target.write_bytes(b"old")
    monkeypatch.setattr(os, step, full_disk)
    with pytest.raises(SprintlabError, match=r"cannot write .*data: No space left on device"):
        atomic_write_bytes(target, b"new")
    assert target.read_bytes() == b"old"
    if step != "fsync":
        with pytest.raises(SprintlabError, match="No space"), atomic_directory(tmp_path / "race") as folder:
            (folder / "half").touch()
    assert list(tmp_path.iterdir()) == [target]


def test_places_that_cannot_be_are_refused_before_any_work(tmp_path):
    (tmp_path / "dangling").symlink_to("nowhere")
    for path in ("dangling/a.json", "a" * 5000 + "/b", "/dev/null"):
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


def test_only_one_of_two_gets_a_folder(tmp_path):
    with reserved_directory(tmp_path / "race"):
        with pytest.raises(SprintlabError, match="exists already"), reserved_directory(tmp_path / "race"):
            raise AssertionError("the name was given twice")
        with atomic_directory(tmp_path / "race") as folder:
            (folder / "result.json").write_text("{}")
    assert (tmp_path / "race" / "result.json").read_text() == "{}"

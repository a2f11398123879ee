"""Files: what is not a regular file, too large, or no text is refused in one sentence."""

import numpy as np
import pytest

from sprintlab.core.archives import read_arrays
from sprintlab.core.errors import RobotModelError, SprintlabError
from sprintlab.core.reading import finite_number, read_bytes, read_json, read_toml


@pytest.mark.parametrize("path", ["/dev/zero", "/", "no such file", "with\0zero"])
def test_only_regular_files_are_read(path):
    with pytest.raises(RobotModelError, match="cannot read robot"):
        read_bytes(path, 100, what="robot", error=RobotModelError)


def test_larger_than_the_limit(tmp_path):
    (tmp_path / "a").write_bytes(bytes(101))
    with pytest.raises(SprintlabError, match="larger than"):
        read_bytes(tmp_path / "a", 100)
    assert len(read_bytes(tmp_path / "a", 101)) == 101


@pytest.mark.parametrize(
    ("read", "texts"),
    [
        (read_toml, ["x = " + "1" * 5000, "x = " + "[" * 5000, "x = "]),
        (read_json, ["[" * 100_000, "{", "", '{"speed": NaN}', "[-Infinity]", "[1e999]"]),
    ],
)
def test_other_text_is_refused(tmp_path, read, texts):
    for text in texts:
        (tmp_path / "a").write_text(text)
        with pytest.raises(SprintlabError, match=r"not a (TOML|JSON) file"):
            read(tmp_path / "a")


def test_cells_of_tables():
    assert [finite_number(cell) for cell in ["1", " -2.5\t", "+.5", "3.", "1e-400"]] == [1, -2.5, 0.5, 3, 0]
    for cell in ["nan", "-Infinity", "1e400", "", " ", "0x10", "1 2"]:
        with pytest.raises(ValueError, match="not a finite number"):
            finite_number(cell)


def test_arrays_come_back(tmp_path):
    given = {"a": np.arange(6.0).reshape(2, 3), "b": np.asfortranarray(np.eye(3)), "c": np.array("text")}
    np.savez_compressed(tmp_path / "a.npz", **given)
    read = read_arrays(tmp_path / "a.npz", ("a", "b", "c", "d"))
    assert read.keys() == given.keys()
    for name, value in given.items():
        assert np.array_equal(read[name], value) and read[name].dtype == value.dtype


def test_other_archives_are_refused_before_they_are_unpickled(tmp_path):
    np.savez(tmp_path / "a.npz", a=np.array([print], dtype=object))
    with pytest.raises(SprintlabError, match="not an npz archive"):
        read_arrays(tmp_path / "a.npz", ("a",))

"""Files from elsewhere: what is not a regular file, too large, or no text is refused in one sentence."""

import zipfile

import numpy as np
import pytest

from sprintlab.core.archives import read_arrays
from sprintlab.core.errors import RobotModelError, SprintlabError
from sprintlab.core.reading import (
    parse_json,
    parse_toml,
    plain_number,
    read_bytes,
    read_json,
    read_toml,
)


@pytest.mark.parametrize("path", ["/dev/zero", "/", "no such file", "with\0zero"])
def test_what_is_no_file_is_refused(path):
    with pytest.raises(RobotModelError, match="cannot read robot"):
        read_bytes(path, 100, what="robot", error=RobotModelError)


def test_larger_than_the_limit(tmp_path):
    (tmp_path / "a").write_bytes(bytes(101))
    with pytest.raises(SprintlabError, match="larger than"):
        read_bytes(tmp_path / "a", 100)
    assert len(read_bytes(tmp_path / "a", 101)) == 101


@pytest.mark.parametrize("text", ["x = " + "1" * 5000, "x = " + "9" * 400, "x = " + "[" * 5000, "x = "])
def test_toml_that_is_none(tmp_path, text):
    with pytest.raises(ValueError):
        parse_toml(text)
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(SprintlabError, match="not a TOML file"):
        read_toml(tmp_path / "a.toml")


@pytest.mark.parametrize("text", ["[" * 100_000, "{", ""])
def test_json_that_is_none(tmp_path, text):
    with pytest.raises(ValueError):
        parse_json(text)
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(SprintlabError, match="not a JSON file"):
        read_json(tmp_path / "a.json")


@pytest.mark.parametrize("text", ['{"speed": NaN}', "[-Infinity]", "[1e999]", '{"speed": -2.5e400}'])
def test_json_files_hold_finite_numbers(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(SprintlabError, match="is not a finite number"):
        read_json(tmp_path / "a.json")


@pytest.mark.parametrize(
    "cell", ["2_2.0", "nan", "-Infinity", "1e400", "１２", "٣", "", " ", "0x10", "1e", "1 2"]
)
def test_cells_that_other_programs_read_differently_are_no_numbers(cell):
    with pytest.raises(ValueError, match="not a finite number"):
        plain_number(cell)


def test_cells_with_numbers():
    cells = ["1", " -2.5\t", "+.5", "3.", "1e-400", "0" * 10**6]
    assert [plain_number(cell) for cell in cells] == [1.0, -2.5, 0.5, 3.0, 0.0, 0.0]


def test_arrays_come_back(tmp_path):
    given = {"a": np.arange(6.0).reshape(2, 3), "b": np.asfortranarray(np.eye(3)), "c": np.array("text")}
    np.savez_compressed(tmp_path / "a.npz", **given)
    read = read_arrays(tmp_path / "a.npz", ("a", "b", "c", "d"))
    assert read.keys() == given.keys()
    for name, value in given.items():
        assert np.array_equal(read[name], value) and read[name].dtype == value.dtype


def test_objects_are_not_unpickled(tmp_path):
    np.savez(tmp_path / "a.npz", a=np.array([print], dtype=object))
    with pytest.raises(SprintlabError, match="not an npz archive"):
        read_arrays(tmp_path / "a.npz", ("a",))


def test_bomb_is_refused_before_it_unpacks(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", bytes(3 << 20))
    with pytest.raises(SprintlabError, match="unpacks to more than"):
        read_arrays(tmp_path / "a.npz", ("a",), limit=1 << 20)

"""Files from elsewhere: what is no regular file, too large, or no text is refused in one sentence."""

import io
import os
import struct
import tracemalloc
import zipfile
import zlib
from contextlib import suppress

import numpy as np
import pytest

from sprintlab.core.archives import named_floats, read_arrays
from sprintlab.core.errors import InvalidValueError, RobotModelError, SprintlabError, printable
from sprintlab.core.reading import (
    parse_json,
    parse_toml,
    plain_number,
    read_bytes,
    read_json,
    read_text,
    read_toml,
)


def test_link_to_a_file_is_followed(tmp_path):
    (tmp_path / "a").write_text("x = 1\n")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    assert read_toml(tmp_path / "b") == {"x": 1}


def test_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(SprintlabError, match="no regular file"):
        read_bytes(tmp_path / "pipe", 100)


def test_a_file_that_would_be_waited_for_is_refused(tmp_path, monkeypatch):
    """As /proc/kmsg: a regular file by its kind that has nothing now."""
    (tmp_path / "file").write_text("x")
    reading, writing = os.pipe()
    os.set_blocking(reading, False)
    status = os.stat(tmp_path / "file")
    with monkeypatch.context() as patch:
        patch.setattr(os, "open", lambda *_: reading)
        patch.setattr(os, "fstat", lambda _: status)
        with pytest.raises(SprintlabError, match="it gives nothing now"):
            read_bytes(tmp_path / "file", 100)
    os.close(writing)


def test_pipe_that_takes_the_place_of_a_file_is_refused(tmp_path, monkeypatch):
    """Between the question what it is and its opening."""
    (tmp_path / "file").write_text("x = 1\n")
    os.mkfifo(tmp_path / "pipe")
    before = os.stat(tmp_path / "file")
    with monkeypatch.context() as patch:
        patch.setattr("sprintlab.core.reading.os.stat", lambda path: before)
        with pytest.raises(SprintlabError, match="no regular file"):
            read_bytes(tmp_path / "pipe", 100)


@pytest.mark.parametrize("path", ["/dev/zero", "/", "no such file", "with\0zero"])
def test_what_is_no_file_is_refused(path):
    with pytest.raises(RobotModelError, match="cannot read robot"):
        read_bytes(path, 100, what="robot", error=RobotModelError)


def test_larger_than_the_limit(tmp_path):
    (tmp_path / "a").write_bytes(bytes(101))
    with pytest.raises(SprintlabError, match="larger than"):
        read_bytes(tmp_path / "a", 100)
    assert len(read_bytes(tmp_path / "a", 101)) == 101


def test_a_file_that_grows_meanwhile_is_not_read_beyond_the_limit(tmp_path, monkeypatch):
    """A terabyte, of which nothing was there when its size was asked for."""
    (tmp_path / "a").touch()
    empty = os.stat(tmp_path / "a")
    os.truncate(tmp_path / "a", 1 << 40)
    monkeypatch.setattr(os, "fstat", lambda handle: empty)
    with pytest.raises(SprintlabError, match="larger than"):
        read_bytes(tmp_path / "a", 100)


@pytest.mark.parametrize("limit", [100, 1 << 39])
def test_endless_sparse_file_is_not_read(tmp_path, limit):
    with open(tmp_path / "a", "wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(SprintlabError, match="larger than"):
        read_text(tmp_path / "a", limit)


@pytest.mark.parametrize(
    "text", ["x = " + "1" * 5000, "x = " + "9" * 400, "x = " + "[" * 5000, "x = ", "a." * 100_000 + "a = 1"]
)
def test_toml_that_is_none(tmp_path, text):
    with pytest.raises(ValueError):
        parse_toml(text)
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(SprintlabError, match="not a TOML file"):
        read_toml(tmp_path / "a.toml")


@pytest.mark.parametrize("text", ["9" * 5000, "9" * 21, "[" * 100_000, "{", ""])
def test_json_that_is_none(tmp_path, text):
    with pytest.raises(ValueError):
        parse_json(text)
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(SprintlabError, match="not a JSON file"):
        read_json(tmp_path / "a.json")


@pytest.mark.parametrize(
    "text",
    [
        r'["\\\ud800"]',
        r'["\ud83d\ud83d\ude00\ude00"]',
        '["\\ud800"]',
        '{"\\uDC00": 1}',
        '["\\ud83d \\ude00"]',
    ],
)
def test_json_with_half_a_character_is_refused(tmp_path, text):
    """Python reads it, and fails where it is printed or written."""
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(SprintlabError, match="not a JSON file"):
        read_json(tmp_path / "a.json")
    assert parse_json('["\\ud83d\\ude00"]') == ["\U0001f600"]
    assert parse_json(r'["\\ud800", "\\\ud83d\ude00\\\\ud800"]') == [r"\ud800", "\\\U0001f600\\\\ud800"]


def test_an_object_of_very_many_names_is_refused():
    with pytest.raises(ValueError, match="more than 200000 names"):
        parse_json("{" + ",".join(f'"{number}":0' for number in range(200_001)) + "}")


@pytest.mark.parametrize("text", ['{"a": 1, "a": 1}', '[{"b": {"a": 1, "\\u0061": 2}}]'])
def test_json_with_a_name_that_stands_twice_is_refused(text):
    with pytest.raises(ValueError, match="the name a stands twice"):
        parse_json(text)


@pytest.mark.parametrize("text", ['{"speed": NaN}', "[-Infinity]", "[1e999]", '{"speed": -2.5e400}'])
def test_json_files_hold_finite_numbers(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(SprintlabError, match="is no finite number"):
        read_json(tmp_path / "a.json")


@pytest.mark.parametrize(
    "cell", ["2_2.0", "nan", "-Infinity", "1e400", "１２", "٣", "", " ", "0x10", "1e", "1 2"]
)
def test_cells_that_other_programs_read_differently_are_no_numbers(cell):
    with pytest.raises(ValueError, match="no finite number"):
        plain_number(cell)


def test_cells_with_numbers():
    cells = ["1", " -2.5\t", "+.5", "3.", "1e-400", "0" * 10**6]
    assert [plain_number(cell) for cell in cells] == [1.0, -2.5, 0.5, 3.0, 0.0, 0.0]


def test_a_folder_that_takes_the_place_of_a_file_is_refused(tmp_path, monkeypatch):
    """Between the question what it is and the opening."""
    (tmp_path / "file").write_text("x = 1\n")
    status = os.stat(tmp_path / "file")
    (tmp_path / "folder").mkdir()
    opened, handles = os.open, []
    with monkeypatch.context() as patch:
        patch.setattr(os, "stat", lambda path, **_: status)
        patch.setattr(os, "open", lambda *arguments: handles.append(opened(*arguments)) or handles[-1])
        with pytest.raises(SprintlabError, match="no regular file"):
            read_bytes(tmp_path / "folder", 100)
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(handles[0])  # it was closed


def test_terminal_codes_are_shown_not_obeyed():
    assert printable("\x1b[2Jabc\r\n‮") == "\\x1b[2Jabc\\r\\n\\u202e"
    assert printable("x" * 1000) == "x" * 300 + "..."
    assert printable("ordinary name, µ") == "ordinary name, µ"


@pytest.mark.parametrize(
    "error",
    [SprintlabError("motor.\x1b[2J\n\u202e is unknown"), InvalidValueError("motor.\x1b[2J\n\u202e", 1, "no")],
)
def test_an_error_in_python_shows_a_strangers_names_and_does_not_obey_them(error):
    assert str(error).startswith("motor.\\x1b[2J \\u202e ")
    assert len(str(SprintlabError("x" * 10**6))) < 3000


def test_arrays_come_back(tmp_path):
    given = {"a": np.arange(6.0).reshape(2, 3), "b": np.asfortranarray(np.eye(3)), "c": np.array("text")}
    np.savez_compressed(tmp_path / "a.npz", **given)
    read = read_arrays(tmp_path / "a.npz", ("a", "b", "c", "d"))
    assert read.keys() == given.keys()
    for name, value in given.items():
        assert np.array_equal(read[name], value) and read[name].dtype == value.dtype


def test_objects_are_not_unpickled(tmp_path):
    np.savez(tmp_path / "a.npz", a=np.array([print], dtype=object))
    with pytest.raises(SprintlabError, match="no npz archive"):
        read_arrays(tmp_path / "a.npz", ("a",))


@pytest.mark.parametrize("header", [b"{'descr': '<f8', (", b"{'descr': '''", b"(" * 90])
def test_a_header_that_ends_too_early_is_told_in_one_sentence(tmp_path, header):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little") + header.ljust(118))
    with pytest.raises(SprintlabError, match="no npz archive"):
        read_arrays(tmp_path / "a.npz", ("a",))


@pytest.mark.parametrize("packing", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_what_numpy_does_not_pack_is_refused(tmp_path, packing):
    """Each packing has errors of its own for what is damaged."""
    with zipfile.ZipFile(tmp_path / "a.npz", "w", packing) as archive:
        archive.writestr("a.npy", np.random.default_rng(0).bytes(1000))
    content = bytearray((tmp_path / "a.npz").read_bytes())
    content[60:90] = b"\xff" * 30
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(SprintlabError, match="no npz archive"):
        read_arrays(tmp_path / "a.npz", ("a",))


def test_bomb_is_refused_before_it_unpacks(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", bytes(3 << 20))
    with pytest.raises(SprintlabError, match="unpacks to more than"):
        read_arrays(tmp_path / "a.npz", ("a",), limit=1 << 20)


def test_a_bomb_that_says_it_is_small_is_not_unpacked(tmp_path):
    """Python's ``ZipFile.read`` unpacks up to 2 GB of a member before it looks at the size that was told."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (0,)})
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", stream.getvalue() + bytes(200 << 20))
    content = (tmp_path / "a.npz").read_bytes()
    told, small = len(stream.getvalue()) + (200 << 20), len(stream.getvalue())
    check, fitting = zlib.crc32(stream.getvalue() + bytes(200 << 20)), zlib.crc32(stream.getvalue())
    for before, after in ((told, small), (check, fitting)):
        assert content.count(struct.pack("<I", before)) == 2
        content = content.replace(struct.pack("<I", before), struct.pack("<I", after))
    (tmp_path / "a.npz").write_bytes(content)
    tracemalloc.start()
    try:
        assert read_arrays(tmp_path / "a.npz", limit=1 << 20)["a"].shape == (0,)
        assert tracemalloc.get_traced_memory()[1] < 20 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("members", "extra"), [(200_000, b""), (1000, bytes(60_000))])
def test_a_long_table_of_contents_is_refused_before_it_is_read(tmp_path, members, extra, monkeypatch):
    """``zipfile`` takes 10 µs for a member and longer for its extra fields: minutes for those of 512 MB."""
    fields = (b"PK\1\2", 20, 20, *[0] * 7, 1, len(extra), *[0] * 5)
    table = members * (struct.pack("<4s6H3L5H2L", *fields) + b"a" + extra)
    size, most, unknown = len(table), 0xFFFFFFFF, 0xFFFF
    end = struct.pack("<4sQ2H2L4Q", b"PK\6\6", 44, 45, 45, 0, 0, members, members, size, 0)
    end += struct.pack("<4sLQL", b"PK\6\7", 0, size, 1)
    end += struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, unknown, unknown, most, most, 0)
    (tmp_path / "a.npz").write_bytes(table + end)
    made = []
    monkeypatch.setattr(zipfile, "ZipInfo", lambda name: made.append(name))
    with pytest.raises(SprintlabError, match="no npz archive"):
        read_arrays(tmp_path / "a.npz")
    assert not made


@pytest.mark.parametrize("code", [0x110000, 0x7FFFFFFF, 0xD800])
@pytest.mark.parametrize("order", "<>")
def test_texts_with_code_points_that_unicode_does_not_have_are_refused(tmp_path, code, order):
    text = np.array([ord("a"), code], f"{order}u4").view(f"{order}U1")
    np.savez(tmp_path / "a.npz", a=text, b=np.array(["\U0010ffff\u202e"]))
    with pytest.raises(SprintlabError, match="no npz archive"):
        read_arrays(tmp_path / "a.npz")
    assert read_arrays(tmp_path / "a.npz", ("b",))["b"].item() == "\U0010ffff\u202e"


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_no_wrong_bit_in_the_table_of_contents_hides_an_array(tmp_path, save):
    """No checksum covers it: joints whose names were not found bore those of other joints."""
    path = tmp_path / "a.npz"
    save(path, joint_names=np.array(["b", "a"]), some_other_name=np.ones(2), third=np.ones(1))
    content, read = path.read_bytes(), 0
    for bit in range(8 * content.index(b"PK\1\2"), 8 * len(content)):
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        with suppress(SprintlabError):
            assert set(read_arrays(path)) == {"joint_names", "some_other_name", "third"}
            read += 1
    assert read > 100  # dates, rights and versions may be anything
    path.write_bytes(content)
    with zipfile.ZipFile(path, "a") as archive:
        archive.comment = b"of whoever made it"
    assert len(read_arrays(path)) == 3


def test_arrays_that_must_be_numbers(tmp_path):
    np.savez(tmp_path / "a.npz", a=np.full(3, 1e4000, np.longdouble), b=np.array(["1"]), c=np.ones(2, bool))
    found = read_arrays(tmp_path / "a.npz")
    assert named_floats("a", found, ("a", "c"), "no table")["a"].tolist() == [np.inf] * 3
    for name in ("b", "d"):
        with pytest.raises(SprintlabError, match="a is no table"):
            named_floats("a", found, (name,), "no table")


def test_shape_that_claims_40_gigabytes(tmp_path):
    header = b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little")
    text = b"{'descr': '<f4', 'fortran_order': False, 'shape': (10000000000,), }"
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", header + text.ljust(117) + b"\n" + bytes(40))
    with pytest.raises(SprintlabError, match="no npz archive"):
        read_arrays(tmp_path / "a.npz", ("a",))


def test_an_array_that_would_take_many_times_its_size_is_refused(tmp_path):
    """Eight bytes a number, whatever the file's numbers have, and some tables of them."""
    np.savez_compressed(tmp_path / "a.npz", a=np.zeros((12_000_001, 1), "u1"), b=np.zeros(10_001, "U1"))
    for name, said in (("a", "12000001 elements; at most 12000000"), ("b", "10001 elements; at most 10000")):
        with pytest.raises(SprintlabError, match=said):
            read_arrays(tmp_path / "a.npz", (name,))


def test_json_that_would_be_parsed_for_long_is_refused(tmp_path):
    """Whole numbers of one digit take longest: 64 MB of them 9 s."""
    (tmp_path / "a.json").write_text(f"[{'1,' * (4 << 20)}1]")
    with pytest.raises(SprintlabError, match="is larger than 8 MB"):
        read_json(tmp_path / "a.json")

"""A small sample of `make fuzz`: broken inputs on every reader of foreign files, and a fuzzer that finds what there is."""

import os
import signal

import cv2
import numpy as np
import pytest

import bench_fuzz
from bench_fuzz import Fault, fuzz, fuzz_all, reached, tried, turn
from fuzz_inputs import png_with_valid_checksums, text_inputs
from fuzz_readers import Reader, readers
from inputs.images import read_image
from rig.errors import InputError, one_line

INPUTS = 12  # each reader; `make fuzz` gives it 100,000


@pytest.fixture(autouse=True)
def found_here(tmp_path, monkeypatch):
    monkeypatch.setattr(bench_fuzz, "FOUND", tmp_path / "found")


@pytest.fixture(scope="module")
def all_readers(tmp_path_factory):
    return readers(tmp_path_factory.mktemp("fuzz") / "all")


def test_no_broken_input_ends_in_a_traceback(all_readers):
    """Fails if a reader lets another error than InputError out, or one whose message is not one printable line."""
    found = {}
    for name, reader in all_readers.items():
        count, taken, last, fault = fuzz(reader, INPUTS)
        if fault:
            found[name] = (str(fault), last)
    assert found == {}


def reader_of(tmp_path, call):
    return Reader(tmp_path / "a.txt", text_inputs([b"name: a\nvalue: 12\n"]), call)


def test_a_reader_that_breaks_is_found_and_its_input_is_small(tmp_path):
    """Fails if the fuzzer takes a traceback for a refusal."""

    def call(path):
        if b"value: 12" not in path.read_bytes():
            raise KeyError("value")

    reader = reader_of(tmp_path, call)
    _, _, last, fault = fuzz(reader, 300)
    assert "KeyError" in str(fault)
    assert last in [reader.inputs.made(b"name: a\nvalue: 12\n", b"name: a\nvalue: 12\n", [edit], False)
                    for number in range(300) for edit in reader.inputs.drawn(number)[2]]  # fmt: skip


def test_an_input_is_known_by_its_number():
    """Fails if what did harm can't be made again, or if all inputs are alike."""
    inputs = text_inputs([b"name: a\nvalue: 12\n"])
    made = [inputs.made(*inputs.drawn(number)) for number in range(40)]
    assert made == [inputs.made(*inputs.drawn(number)) for number in range(40)]
    assert len(set(made)) > 30


def test_the_next_call_goes_on_and_begins_anew_what_did_harm(tmp_path):
    """Fails if inputs are tried twice, or if a reader that was fixed is not tried from its first input on."""
    table_path = tmp_path / "fuzz.csv"
    seen = []
    all_readers = {"right": reader_of(tmp_path, lambda path: None), "wrong": reader_of(tmp_path, fail)}
    for inputs in (3, 5):
        table = reached(list(all_readers), table_path, anew=False)
        seen.append(table.inputs.to_dict())
        fuzz_all(all_readers, table, list(all_readers), inputs, table_path)
    assert seen == [{"right": 0, "wrong": 0}, {"right": 3, "wrong": 0}]
    assert table.inputs.to_dict() == {"right": 5, "wrong": 0}
    assert "KeyError" in table.harm["wrong"] and not table.harm["right"]


def fail(path):
    raise KeyError("value")


def test_a_reader_whose_process_ends_is_told(tmp_path):
    """Fails if a crash in a library passes for a refusal, or ends the fuzzer."""
    reader = reader_of(tmp_path, lambda path: os.kill(os.getpid(), signal.SIGKILL))
    assert turn("a", reader, 0, 3)[3] == "the process ended with -9"


def test_messages_of_several_lines_are_found(tmp_path):
    """Fails if only the kind of an error counts, and not what a user would read."""

    def call(path):
        error = InputError("a")
        error.args = ("two\nlines",)
        raise error

    with pytest.raises(Fault, match="no printable line"):
        tried(reader_of(tmp_path, call), b"")


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("a\n  b", "a b"), ("Jörg's  rig", "Jörg's  rig"),
        ("\x1b[31mred\0", r"\x1b[31mred\x00"), ("\u202e\ud800", r"\u202e\ud800"),
        ("x" * 3000, "x" * 1996 + " ..."),
    ],
)  # fmt: skip
def test_a_message_is_one_printable_line(message, shown):
    """Fails if a file could write to a terminal what it likes: colours, line ends, letters that run backwards."""
    assert one_line(message) == shown and str(InputError(message)) == shown


def test_images_with_valid_checksums_are_read_beyond_them(tmp_path):
    """Fails if all that is tried of PNG is its checksum."""
    data = bytearray(cv2.imencode(".png", np.zeros((8, 9), np.uint8))[1].tobytes())
    data[-20] ^= 1  # among the pixels
    (tmp_path / "a.png").write_bytes(data)
    with pytest.raises(InputError, match="checksum"):
        read_image(tmp_path / "a.png")
    (tmp_path / "a.png").write_bytes(png_with_valid_checksums(bytes(data)))
    with pytest.raises(InputError) as error:
        read_image(tmp_path / "a.png")
    assert "checksum" not in str(error.value)

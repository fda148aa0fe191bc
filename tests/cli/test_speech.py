"""How a command ends: one clear line for users' errors, a traceback for the program's own."""

import pytest

from commands import error_line, files_in, run
from sklearn_mcmd.cli import _denoise


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (MemoryError(), 1, "not enough memory"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_memory_and_interrupts_end_in_one_line_and_keep_the_old_file(
    error, code, text, room_file, monkeypatch
):
    def fail(*args, **kwargs):
        raise error

    before = room_file.read_bytes()
    monkeypatch.setattr(_denoise, "_find_outliers", fail)
    assert text in error_line(run("denoise", room_file, room_file), code)
    assert room_file.read_bytes() == before
    assert files_in(room_file.parent) == ["room.laz"]


def test_an_error_of_the_program_itself_is_not_hidden(room_file, tmp_path, monkeypatch):
    monkeypatch.setattr(_denoise, "_find_outliers", lambda *args, **kwargs: 1 / 0)
    result = run("denoise", room_file, tmp_path / "out.laz")
    assert isinstance(result.exception, ZeroDivisionError)

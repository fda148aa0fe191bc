"""How a command ends: one clear line for users' errors, a traceback for the program's own."""

import warnings

import pytest

from commands import error_line, files_in, run
from sklearn_mcmd.cli import _denoise


@pytest.fixture
def failing(monkeypatch):
    """What makes the work of `mcmd denoise` end in an error."""

    def set_error(error):
        def fail(*args, **kwargs):
            raise error

        monkeypatch.setattr(_denoise, "_find_outliers", fail)

    return set_error


def test_lack_of_memory_ends_in_one_line_and_keeps_the_old_file(failing, room_file):
    failing(MemoryError())
    before = room_file.read_bytes()
    assert "not enough memory" in error_line(run("denoise", room_file, room_file))
    assert room_file.read_bytes() == before
    assert files_in(room_file.parent) == ["room.laz"]


def test_an_interrupt_ends_in_one_line_and_keeps_the_old_file(failing, room_file):
    failing(KeyboardInterrupt())
    before = room_file.read_bytes()
    result = run("denoise", room_file, room_file)
    assert (result.exit_code, result.stderr) == (130, "mcmd: interrupted\n")
    assert room_file.read_bytes() == before
    assert files_in(room_file.parent) == ["room.laz"]


def test_an_error_of_the_program_itself_is_not_hidden(room_file, tmp_path, monkeypatch):
    monkeypatch.setattr(_denoise, "_find_outliers", lambda *args, **kwargs: 1 / 0)
    result = run("denoise", room_file, tmp_path / "out.laz")
    assert isinstance(result.exception, ZeroDivisionError)


def test_deprecations_within_libraries_are_not_told_to_users(room_file, tmp_path, monkeypatch):
    # pyparsing's are of both kinds, and old versions of Matplotlib give them.
    class Deprecated(UserWarning, DeprecationWarning):
        pass

    find = _denoise._find_outliers

    def warn(*args, **kwargs):
        warnings.warn("parseString is deprecated", Deprecated, stacklevel=2)
        warnings.warn("the scan is sparse", UserWarning, stacklevel=2)
        return find(*args, **kwargs)

    monkeypatch.setattr(_denoise, "_find_outliers", warn)
    result = run("denoise", room_file, tmp_path / "out.laz", "--quiet")
    assert result.stderr == "mcmd: warning: the scan is sparse\n"

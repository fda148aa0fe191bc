"""The mcmd command as a whole: its version, and help for every verb."""

import pytest

from commands import run
from sklearn_mcmd import __version__


def test_version_is_printed(tmp_path):
    result = run("--version")
    assert (result.exit_code, result.stdout) == (0, f"mcmd {__version__}\n")


@pytest.mark.parametrize("verb", ["denoise", "normals", "segment", "info", "demo"])
def test_every_verb_has_help(verb):
    result = run(verb, "--help")
    assert result.exit_code == 0
    assert "Usage: mcmd" in result.stdout

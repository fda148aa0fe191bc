"""The mcmd command as a program: exit codes, and libraries that are missing or not needed."""

import subprocess
import sys
from pathlib import Path

import pytest


def program(*args, code=None):
    command = [sys.executable, *(["-c", code] if code else ["-m", "sklearn_mcmd"])]
    return subprocess.run(
        [*command, *map(str, args)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[1],
        timeout=600,
    )


def test_the_module_runs_as_a_program_and_exits_with_the_verbs_code(room_file, tmp_path):
    done = program("info", room_file)
    assert (done.returncode, done.stderr) == (0, "")
    failed = program("info", tmp_path / "none.laz")
    assert failed.returncode == 1
    assert failed.stderr == f"mcmd: error: {tmp_path / 'none.laz'}: no such file\n"


@pytest.mark.parametrize("library", ["typer", "rich"])
def test_without_its_libraries_the_command_says_how_to_get_them(library):
    done = program(
        code=f"import sys; sys.modules[{library!r}] = None\n"
        "from sklearn_mcmd.__main__ import main; main()"
    )
    assert done.returncode == 1
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert "its extra [cli]" in done.stderr


@pytest.mark.parametrize(
    ("work", "heavy"),
    [
        (
            "from typer.main import get_command\nfrom sklearn_mcmd.cli import app\n"
            "root = get_command(app)\n"
            "root.get_help(root.context_class(root))  # prints it",
            ["numpy", "sklearn_mcmd.io", "matplotlib", "numba", "laspy", "scipy", "sklearn"],
        ),
        (
            "import numpy, sklearn_mcmd.cli._info as cli\n"
            "from sklearn_mcmd.io import PointCloud\n"
            "cli.summarize(cli.Path('a.npy'), PointCloud(numpy.eye(3)))",
            ["matplotlib", "numba", "laspy", "sklearn"],
        ),
    ],
    ids=["help", "info"],
)
def test_no_library_is_loaded_that_is_not_needed(work, heavy):
    done = program(code=f"import sys\n{work}\nprint([m for m in {heavy} if m in sys.modules])")
    assert done.stdout.splitlines()[-1:] == ["[]"], done.stderr

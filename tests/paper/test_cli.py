"""``python -m sklearn_mcmd.paper``: commands, files and errors."""

import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from sklearn_mcmd.paper import EXPERIMENTS, table2
from sklearn_mcmd.paper._cli import app


def run(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments], prog_name="paper")


def test_the_list_names_every_table_and_figure():
    result = run("list")
    assert result.exit_code == 0
    names = [line.split()[0] for line in result.stdout.splitlines()[1:]]
    assert names == list(EXPERIMENTS)
    assert {*(f"table{i}" for i in range(1, 7)), "cost"} <= set(names)
    assert {f"figure{i}" for i in range(3, 16)} <= set(names)


def test_a_command_prints_the_report():
    result = run("table2", "--runs", 3, "--seed", 5)
    assert result.exit_code == 0, result.output
    assert str(table2(3, seed=5)) in result.stdout


def test_out_holds_the_plot_and_the_text_and_nothing_else(tmp_path):
    folder = tmp_path / "new" / "folder"
    result = run("figure8", "--runs", 3, "--out", folder)
    assert result.exit_code == 0, result.output
    assert sorted(p.name for p in folder.iterdir()) == ["figure8.png", "figure8.txt"]
    assert (folder / "figure8.png").read_bytes().startswith(b"\x89PNG")
    text = (folder / "figure8.txt").read_text(encoding="utf-8")
    assert text.strip() in result.stdout


def test_a_plot_that_fails_leaves_the_old_one(tmp_path, monkeypatch):
    (tmp_path / "table2.png").write_bytes(b"old")
    monkeypatch.setattr(
        "matplotlib.figure.Figure.savefig", lambda *args, **kwargs: 1 / 0, raising=True
    )
    result = run("table2", "--runs", 2, "--out", tmp_path)
    assert result.exit_code == 1
    assert (tmp_path / "table2.png").read_bytes() == b"old"
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("arguments", [("--runs", 1), ("--seed", -1), ("--runs", "many")])
def test_a_bad_option_is_wrong_usage(arguments):
    result = run("table1", *arguments)
    assert result.exit_code == 2
    assert arguments[0] in result.stderr


def test_an_out_folder_that_is_a_file_is_one_clear_line(tmp_path):
    path = tmp_path / "file"
    path.touch()
    result = run("table2", "--runs", 2, "--out", path)
    assert result.exit_code == 1
    assert len(result.stderr.splitlines()) == 1
    assert str(path) in result.stderr


def python(code):
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=dict(os.environ)
    )


@pytest.mark.parametrize("missing", ["typer", "rich"])
def test_without_its_libraries_the_command_line_names_the_extra(missing):
    code = (
        f"import sys; sys.modules[{missing!r}] = None\n"
        "from sklearn_mcmd.paper.__main__ import main; main(['list'])"
    )
    result = python(code)
    assert result.returncode == 1
    assert 'pip install "typer>=' in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_without_matplotlib_an_out_folder_is_refused_before_any_work(tmp_path):
    code = (
        "import sys; sys.modules['matplotlib'] = None\n"
        "from sklearn_mcmd.paper.__main__ import main\n"
        f"main(['table2', '--runs', '2', '--out', {str(tmp_path / 'new')!r}])"
    )
    result = python(code)
    assert result.returncode == 1
    assert 'pip install "matplotlib>=' in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert result.stdout == ""
    assert not list(tmp_path.iterdir())


def test_without_matplotlib_a_plot_names_the_extra_and_tables_still_print():
    code = (
        "import sys; sys.modules['matplotlib'] = sys.modules['matplotlib.pyplot'] = None\n"
        "from sklearn_mcmd.paper import table2\n"
        "report = table2(2)\n"
        "print(report)\n"
        "report.plot()"
    )
    result = python(code)
    assert "variances along x and y" in result.stdout
    assert 'pip install "matplotlib>=' in result.stderr

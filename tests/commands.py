"""The mcmd command as tests call it, and what they ask of its outcome."""

from typer.testing import CliRunner

from sklearn_mcmd.cli import app


def run(*args):
    """The outcome of a command, streams apart."""
    return CliRunner().invoke(app, [str(a) for a in args], prog_name="mcmd")


def done(*args):
    """The outcome of a command that must succeed."""
    result = run(*args)
    assert result.exit_code == 0, result.output
    return result


def error_line(result, code=1):
    """The one line on stderr of a command that failed as users' errors should."""
    assert result.exit_code == code, result.output
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("mcmd: error: ")
    return lines[0]


def usage_error(result):
    """What is in the box of wrong usage, its lines joined."""
    assert result.exit_code == 2, result.output
    lines = [line.strip("│╭╮╰╯─ ") for line in result.stderr.splitlines()]
    return " ".join(" ".join(lines).split())


def files_in(folder):
    return sorted(p.name for p in folder.iterdir())

"""The code blocks of a page of the documentation, and how to run them."""

import contextlib
import io
import re
import shlex
import textwrap
from typing import NamedTuple

from commands import run

DIRECTIVE = re.compile(r"( *)\.\. code-block:: (\S+)$")


class Block(NamedTuple):
    """A code block: its language, its text, the number of its first line, and its indentation."""

    language: str
    text: str
    line: int
    indent: int


def blocks(text):
    """All code blocks of a page, in order."""
    lines, found, i = text.splitlines(), [], 0
    while i < len(lines):
        start = DIRECTIVE.match(lines[i])
        i += 1
        if not start:
            continue
        indent = len(start[1])
        while i < len(lines) and (lines[i].strip().startswith(":") or not lines[i].strip()):
            i += 1
        first = i
        while i < len(lines) and (not lines[i].strip() or _indent(lines[i]) > indent):
            i += 1
        body = textwrap.dedent("\n".join(lines[first:i])).strip("\n") + "\n"
        found.append(Block(start[2], body, first + 1, indent))
    return found


def run_python(block, names, shown=None):
    """Run a block; what it prints is what the block `shown` below it holds."""
    out = io.StringIO()
    code = "\n" * (block.line - 1) + block.text  # errors tell lines of the page
    with contextlib.redirect_stdout(out):
        exec(compile(code, names["__name__"], "exec"), names)
    if shown is not None:
        # A page takes off the spaces that all lines begin with.
        assert textwrap.dedent(out.getvalue()) == shown.text


def run_console(block):
    """Run the commands behind ``$``; what is shown below a command is what it prints.

    A line ``...`` stands for any lines. Blocks with other programs than mcmd are not run.
    """
    commands = re.split(r"^\$ ", block.text, flags=re.MULTILINE)
    assert commands[0] == "", "a console block begins with $"
    if not all(command.startswith("mcmd ") for command in commands[1:]):
        return
    for command in commands[1:]:
        told, _, expected = command.partition("\n")
        done = run(*shlex.split(told, comments=True)[1:])
        assert done.exit_code == 0, done.output
        if expected.strip():
            wanted = "".join(
                "(?:.*\n)*" if line == "..." else re.escape(line) + "\n"
                for line in _comparable(expected)
            )
            printed = "".join(f"{line}\n" for line in _comparable(done.stdout))
            assert re.fullmatch(wanted, printed), f"{told}\n{printed}"


def _indent(line):
    return len(line) - len(line.lstrip())


def _comparable(text):
    """Lines without what differs from run to run: seconds, and widths of columns."""
    lines = (" ".join(line.split()) for line in text.splitlines())
    return [line for line in lines if line and not line.startswith("seconds ")]

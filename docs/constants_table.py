"""The table of constants, made from the source: each number, its value and what it means.

A rule's threshold is a field of a record, a class named ``...Limits``; other numbers are names of
modules in capitals. The comment beside a number, or above it, says what it means. What a threshold
buys stands in constants.csv, a row for each. The directive ``constants`` shows both.
"""

import ast
import csv
import functools
import io
import re
import tokenize
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PRICES = Path(__file__).with_name("constants.csv")
WHOLE = ast.Constant, ast.UnaryOp, ast.BinOp, ast.Tuple, ast.Attribute, ast.Name


class Number(NamedTuple):
    """A number of the package. `name` is ``Record.field`` of a threshold, or ``module.NAME``."""

    name: str
    value: str
    meaning: str
    path: Path
    line: int


def thresholds(root=ROOT):
    """Fields of records of limits that have a value."""
    return [
        number._replace(name=f"{record.name}.{number.name}")
        for path, tree, comments in _sources(root)
        for record in tree.body
        if isinstance(record, ast.ClassDef) and record.name.endswith("Limits")
        for number in _numbers(path, record.body, comments)
    ]


def others(root=ROOT):
    """Numbers in capitals of modules."""
    return [
        number._replace(name=f"{path.parent.name}.{path.stem.lstrip('_')}.{number.name}")
        for path, tree, comments in _sources(root)
        for number in _numbers(path, tree.body, comments)
        if number.name.isupper()
    ]


def prices(path=PRICES):
    """Rows of constants.csv. A threshold that several rules read has one of each."""
    with path.open(newline="", encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


def copies(root=ROOT):
    """Where a module, or the default of an argument, reads a record of limits at import."""
    found = []
    for path, tree, _ in _sources(root):
        functions = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))
        read = [node.value for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign)]
        for function in functions:
            read += [*function.args.defaults, *filter(None, function.args.kw_defaults)]
        found += [
            f"{path.relative_to(root)}:{node.lineno}"
            for value in filter(None, read)
            for node in ast.walk(value)
            if isinstance(node, ast.Name) and node.id.endswith("Limits")
        ]
    return found


def setup(app):
    """Give Sphinx the directive ``constants``, of a part or of what is no threshold."""
    from docutils.parsers.rst import Directive
    from docutils.statemachine import StringList

    class Table(Directive):
        has_content, optional_arguments = False, 1

        def run(self):
            from docutils import nodes

            for path in (PRICES, __file__, *{str(number.path) for number in thresholds()}):
                self.state.document.settings.env.note_dependency(str(path))
            rows = list(_priced(self.arguments[0]) if self.arguments else _rest())
            if len(rows) == 1:
                return []
            text = io.StringIO()
            csv.writer(text, quoting=csv.QUOTE_ALL, lineterminator="\n").writerows(rows)
            lines = [".. csv-table::", "   :header-rows: 1", "   :widths: auto", ""]
            lines += [f"   {line}" for line in text.getvalue().splitlines()]
            node = nodes.Element()
            self.state.nested_parse(StringList(lines, "constants"), self.content_offset, node)
            return node.children

    app.add_directive("constants", Table)
    return {"parallel_read_safe": True}


@functools.cache
def _sources(root):
    found = []
    for path in sorted((root / "sklearn_mcmd").rglob("*.py")):
        with path.open("rb") as lines:
            comments = {
                token.start[0]: token
                for token in tokenize.tokenize(lines.readline)
                if token.type == tokenize.COMMENT
            }
        found.append((path, ast.parse(path.read_text(encoding="utf-8")), comments))
    return found


def _numbers(path, body, comments):
    for node in body:
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            target = node.targets[0]
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            target = node.target
        else:
            continue
        if isinstance(target, ast.Name) and _is_number(node.value):
            meaning = _meaning(node, comments)
            yield Number(target.id, ast.unparse(node.value), meaning, path, node.lineno)


def _is_number(value):
    """Whether an expression is made of numbers, and has one that is written out."""
    parts = [part for part in ast.walk(value) if isinstance(part, ast.expr)]
    written = [part.value for part in parts if isinstance(part, ast.Constant)]
    return (
        all(isinstance(part, WHOLE) for part in parts)
        and all(type(one) in (int, float) for one in written)
        and (bool(written) or "inf" in ast.unparse(value))
    )


def _meaning(node, comments):
    """The comment beside a number, else the comments above it."""
    beside = comments.get(node.end_lineno)
    if beside is not None:
        return _as_rst(beside.string)
    above, line = [], node.lineno - 1
    while line in comments and not comments[line].line[: comments[line].start[1]].strip():
        above.insert(0, _as_rst(comments[line].string))
        line -= 1
    return " ".join(above)


def _as_rst(comment):
    return re.sub("`+", "``", comment.lstrip("#: ")).replace("|", r"\|")


def _priced(part):
    known = {number.name: number for number in thresholds()}
    rows = [row for row in prices() if row["part"] == part]
    columns = [name for name in ("less", "more", "off") if any(row[name] for row in rows)]
    yield ["threshold", *columns]
    seen = set()
    for row in rows:
        number = known[row["constant"]]
        words = [number.meaning] if number.name not in seen else []
        words += [f"({row['where']})"] * bool(row["where"]) + [row["note"]] * bool(row["note"])
        numbers = (row[name].replace(" ", "\N{NO-BREAK SPACE}") for name in columns)
        yield [_cell(number, "; ".join(words).replace("; (", " (")), *numbers]
        seen.add(number.name)


def _rest():
    yield ["number"]
    for number in others():
        yield [_cell(number, number.meaning)]


def _cell(number, words):
    return f"``{number.name}`` = {number.value}\n\n{words}"

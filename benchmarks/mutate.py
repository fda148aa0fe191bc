"""Change the code in small ways, and see whether tests notice: mutation testing of a room.

    pip install coverage
    python benchmarks/mutate.py FOLDER map tests/planes sklearn_mcmd/planes
    python benchmarks/mutate.py FOLDER run planes 50    # goes on with FOLDER/mutants.csv

The first says which tests, of any arguments of pytest, execute which line. The second makes mutants
of 50 lines that a seed draws from those that tests execute, in functions and constants of modules.
Limits of records are constants, too. Each is one change, in the memory of a process that has
collected the tests; no file changes.
Messages, decorators and annotations are left alone. The tests of the line follow each other, the
quickest first, up to BUDGET seconds. With NUMBA_DISABLE_JIT=1 both look at compiled functions,
and at nothing else.
"""

import ast
import csv
import gc
import json
import os
import random
import signal
import sys
from collections import Counter
from contextlib import suppress
from importlib import import_module
from io import BytesIO
from itertools import accumulate, pairwise
from pathlib import Path
from tokenize import NAME, NUMBER, OP, tokenize
from types import FunctionType, ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
PYTHON = os.environ.get("NUMBA_DISABLE_JIT") == "1"
BUDGET, LONGEST = 12, 7 if PYTHON else 600  # seconds of a mutant's tests, and of one test
FIELDS = ("room", "file", "line", "at", "was", "now", "outcome", "by")
BOTH_WAYS = """
+ - * / & | << >> == != += -= *= /= &= |= and or True False min max minimum maximum
argmin argmax any all floor ceil
"""
SWAPS = {"not": [""], "~": [""], "is": ["is not"], "in": ["not in"]}
SWAPS |= {"<": ["<=", ">="], "<=": ["<", ">"], ">": [">=", "<="], ">=": [">", "<"]}
SWAPS |= {"**": ["*"], "//": ["*"], "%": ["*"]}
for one, other in zip(BOTH_WAYS.split()[::2], BOTH_WAYS.split()[1::2], strict=True):
    SWAPS |= {one: [other], other: [one]}


def changes(source):
    """All changes of a file: offset, what was there and comes there, line, and the new source."""
    text, body, alone, found = source.encode(), ast.parse(source).body, [], []
    starts = [0, *accumulate(map(len, text.splitlines(keepends=True)))]

    def span(node):
        first, last = starts[node.lineno - 1], starts[node.end_lineno - 1]
        return first + node.col_offset, last + node.end_col_offset

    methods = [node for made in body if isinstance(made, ast.ClassDef) for node in made.body]
    allowed = [span(node) for node in body if isinstance(node, ast.Assign)]
    allowed += [span(node) for node in body + methods if isinstance(node, ast.FunctionDef)]
    allowed += [span(node) for node in methods if isinstance(node, ast.AnnAssign) and node.value]
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Raise() | ast.Call(func=ast.Attribute(attr="warn")) | ast.JoinedStr():
                alone.append(span(node))
            case ast.AnnAssign() | ast.arg() if node.annotation:
                alone.append(span(node.annotation))
            case ast.FunctionDef():
                alone += [span(part) for part in [*node.decorator_list, node.returns] if part]
            case ast.Return(value=ast.expr()) if ast.unparse(node.value) != "None":
                found.append((*span(node.value), "None", node.lineno))
            case ast.Slice():
                for end in (node.lower, node.upper):
                    if end and not isinstance(end, ast.Constant):
                        found.append((span(end)[1], span(end)[1], " - 1", end.end_lineno))
            case ast.Call():
                parts = [node.func, *node.args, *(keyword.value for keyword in node.keywords)]
                for keyword in node.keywords:
                    first, last = span(keyword)
                    before = max(span(part)[1] for part in parts if span(part)[1] <= first)
                    if text[before:first].strip() == b"," and keyword.arg:
                        found.append((before, last, "", keyword.lineno))
    before = ""
    for token in tokenize(BytesIO(text).readline):
        if token.type in (NAME, NUMBER, OP):
            was, row = token.string, token.start[0]
            at = starts[row - 1] + len(token.line[: token.start[1]].encode())
            new = SWAPS.get(was, ()) if was[0] != "*" or before not in "([," else ()
            if token.type == NUMBER:
                value = ast.literal_eval(was)
                new = [repr(value + 1 if isinstance(value, int) else value * 2 or 1.0)]
            found += [(at, at + len(was.encode()), now, row) for now in new]
            before = was
    for first, last, now, line in found:
        inside = [any(a <= first < b for a, b in spans) for spans in (allowed, alone)]
        if inside == [True, False]:
            was = " ".join(text[first:last].decode().split())
            yield first, was, now, line, (text[:first] + now.encode() + text[last:]).decode()


def patch(file, source):
    """Put a changed file in place of the one in memory; whether that changes anything."""
    name, path, changed = file[:-3].replace("/", "."), str(ROOT / file), False
    module, new, functions = import_module(name), ModuleType(name), {False: [], True: []}
    gc.unfreeze()  # the settings of tests hide what was collected
    exec(compile(source, path, "exec"), vars(new))
    for thing in gc.get_objects():
        if isinstance(thing, FunctionType) and thing.__code__.co_filename == path:
            functions[thing.__globals__ is vars(new)].append(thing)
    made = {(f.__code__.co_qualname, f.__code__.co_firstlineno): f for f in functions[True]}
    for old in functions[False]:
        now = made.get((old.__code__.co_qualname, old.__code__.co_firstlineno), old)
        changed |= old.__code__ != now.__code__
        changed |= repr(old.__defaults__) != repr(now.__defaults__)  # some are arrays
        changed |= repr(old.__kwdefaults__) != repr(now.__kwdefaults__)
        for part in ("__code__", "__defaults__", "__kwdefaults__"):
            setattr(old, part, getattr(now, part))
    for key, was in list(vars(module).items()):
        if key.endswith("Limits") and was.__module__ == name:
            now = getattr(new, key).__new__.__defaults__
            changed |= was.__new__.__defaults__ != now
            was.__new__.__defaults__ = now
        if key.isupper() and repr(was) != repr(vars(new)[key]):
            changed = True
            for user in [m for n, m in sys.modules.items() if n.startswith("sklearn_mcmd.")]:
                if vars(user).get(key) is was:
                    setattr(user, key, vars(new)[key])
    return changed


class Session:
    """A plugin of pytest that calls back with each test, or instead of running them."""

    def __init__(self, each=lambda test: None, instead=lambda session: None):
        self.pytest_runtest_logstart = lambda nodeid: each(nodeid)
        self.instead, self.tests, self.failed = instead, {}, ""

    def pytest_runtestloop(self, session):
        self.items = {item.nodeid: item for item in session.items}
        return self.instead(self)

    def pytest_runtest_logreport(self, report):
        seconds, passed = self.tests.get(report.nodeid, (0, True))
        self.tests[report.nodeid] = seconds + report.duration, passed and report.passed
        self.failed = self.failed or (report.nodeid if report.failed else "")

    def outcome(self, file, source, order, seconds, note):
        """What a child of this process finds: the fate of a mutant, and the test that kills it."""
        note.write_text("killed\nits import")
        if child := os.fork():
            os.waitpid(child, 0)
            return note.read_text().partition("\n")[::2]
        signal.alarm(int(seconds))
        found = "survived" if patch(file, source) else "not applied"
        note.write_text("killed\ntoo long")
        for test, following in pairwise([*order, None] if found == "survived" else ()):
            item, after = self.items[test], self.items.get(following)
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
            if self.failed:
                found = f"killed\n{self.failed}"
                break
        note.write_text(found)
        os._exit(0)


class TooLong(BaseException):
    """Hypothesis looks for no smaller example of it."""


def draw_map(folder, *arguments):
    """Keep which tests execute which lines, and which lines there are."""
    from coverage import Coverage

    def each(test):
        cover.switch_context(test)
        signal.alarm(LONGEST)

    def stop(*_):
        raise TooLong

    signal.signal(signal.SIGALRM, stop)
    cover = Coverage(data_file=None, source=[str(ROOT / "sklearn_mcmd")])
    cover.start()
    pytest.main([*arguments, "-q"], plugins=[session := Session(each)])
    cover.stop()
    data, lines = cover.get_data(), {}
    for path in data.measured_files():
        if path.endswith(".py") and path.endswith("_numba.py") == PYTHON:
            statements = cover.analysis2(path)[1]
            lines[os.path.relpath(path, ROOT)] = data.contexts_by_lineno(path), statements
    kept = folder / f"map_{len(list(folder.glob('map_*')))}.json"
    kept.write_text(json.dumps([PYTHON, session.tests, lines]), "utf-8")


def run(folder, room, n=50, seed=0):
    """Ask about the room's first n mutants that have no row in the table, and count outcomes."""
    seconds, lines, found, drawn, table = {}, {}, {}, [], folder / "mutants.csv"
    for path in sorted(folder.glob("map_*.json")):
        python, tests, executed = json.loads(path.read_text("utf-8"))
        if python == PYTHON:
            seconds |= {name: s for name, (s, passed) in tests.items() if passed}
        for file, (by_line, _) in executed.items():
            for line, names in by_line.items():
                lines.setdefault(file, {}).setdefault(int(line), set()).update(names)
    for file in sorted(file for file in lines if f"/{room}/" in file):
        for change in changes((ROOT / file).read_text("utf-8")):
            if change[3] in lines[file]:
                found.setdefault((file, change[3]), []).append(change)
    random.seed(f"{seed} {room}")
    for file, line in random.sample(list(found), len(found)):
        at, was, now, _, source = random.choice(found[file, line])
        with suppress(SyntaxError):
            compile(source, file, "exec")
            drawn.append((source, [room, file, str(line), str(at), was, now]))
    if not table.exists():
        table.write_text(",".join(FIELDS) + "\n", "utf-8")
    done = [row[:6] for row in csv.reader(table.open(encoding="utf-8"))]

    def ask(session):
        for source, row in drawn[: int(n)]:
            if row in done or row[1].endswith("_numba.py") != PYTHON:
                continue
            executed, asked = lines[row[1]], seconds.keys() & session.items.keys()
            tests = executed[int(row[2])] & asked
            tests = tests or set().union(*executed.values()) & asked  # imports execute it
            mirror, order = f"test{Path(row[1]).stem.removesuffix('_numba')}.py", []
            for test in sorted(tests, key=lambda test: (mirror not in test, seconds[test])):
                if not order or sum(seconds[t] for t in [*order, test]) < BUDGET:
                    order.append(test)
            longest = 20 + 5 * sum(seconds[t] for t in order)
            row += session.outcome(row[1], source, order, longest, folder / "outcome.txt")
            with table.open("a", encoding="utf-8", newline="") as stream:
                csv.writer(stream).writerow(row)
        return True

    files = sorted({test.split("::")[0] for test in seconds})
    pytest.main(["-s", "-q", *files], plugins=[Session(instead=ask)])
    rows = [row for row in csv.reader(table.open(encoding="utf-8")) if row[0] == room]
    for _, file, line, _, was, now, fate, _ in rows:
        if fate == "survived":
            print(f"{file}:{line}\n- {was}\n+ {now}")
    print(room, dict(Counter(row[6] for row in rows)))


if __name__ == "__main__":
    os.chdir(ROOT)
    {"map": draw_map, "run": run}[sys.argv[2]](Path(sys.argv[1]).resolve(), *sys.argv[3:])

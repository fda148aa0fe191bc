"""Who imports whom: arrows go one way."""

import ast
import re
from pathlib import Path

import pytest

import sklearn_mcmd

ROOT = Path(sklearn_mcmd.__file__).parent
# Each room, and the rooms that it may import; those of SHARED are open to all others.
SHARED = {
    "_choices": set(),
    "_errors": set(),
    "_extras": set(),
    "_sklearn": set(),
    "_validation": {"_errors"},
    "runtime": {"_errors"},
}
ROOMS = {
    "planes": "",
    "datasets": "",
    "metrics": "",
    "io": "",
    "adjustment": "planes",
    "baselines": "planes",
    "sensors": "planes",
    "outliers": "planes sensors",
    "normals": "planes baselines",
    "segmentation": "planes normals",  # estimates normals where none are given
    "edges": "planes normals outliers",  # likewise, of a cleaned cloud
    "change": "planes normals outliers segmentation adjustment",
    "tiling": "change planes normals outliers edges segmentation plotting io report sensors",
    "view": "io",
    "plotting": "io view",
    "report": "adjustment io outliers planes plotting view",
    "cli": "adjustment change datasets edges io metrics normals outliers planes plotting report "
    "segmentation sensors tiling view",
    "__main__": "cli",
}
ROOMS = {room: set(below.split()) for room, below in ROOMS.items()}
# Lines of each room, and of what stands beside the package.
LINES = {
    **{"adjustment": 3712, "baselines": 1443, "change": 1099, "cli": 2591, "datasets": 1307},
    **{"edges": 1088, "io": 3650, "metrics": 324, "normals": 1945},
    **{"outliers": 2156, "planes": 5559, "plotting": 789, "report": 1203, "runtime": 445},
    **{"segmentation": 2323, "sensors": 544, "tiling": 3361, "view": 790},
    **{"benchmarks": 5550, "docs": 5724, "tests": 25206},
}
# Compiled functions are imported by strings.
COMPILED = re.compile(r"\w+(\.\w+)*_numba")


def room_of(path):
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def imports_of(path):
    """Rooms that a file imports, wherever in it, but not in its examples."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module]
            if node.module == "sklearn_mcmd":
                names = [f"sklearn_mcmd.{alias.name}" for alias in node.names]
            for name in names:
                if name.startswith("sklearn_mcmd."):
                    yield home_of(name.split(".")[1])
        elif isinstance(node, ast.Constant) and COMPILED.fullmatch(str(node.value)):
            yield node.value.split(".")[0]


def home_of(name):
    """The room of a name: an estimator that is imported from the package itself has one too."""
    return getattr(sklearn_mcmd, name).__module__.split(".")[1] if name[0].isupper() else name


@pytest.mark.parametrize("room", [*SHARED, *ROOMS])
def test_a_room_imports_only_rooms_below(room):
    paths = [path for path in ROOT.rglob("*.py") if room_of(path) == room]
    assert paths
    imported = {name for path in paths for name in imports_of(path)}
    below = SHARED[room] if room in SHARED else ROOMS[room] | SHARED.keys()
    assert imported <= below | {room, "__version__"}


def test_every_file_belongs_to_a_room():
    rooms = {room_of(path) for path in ROOT.rglob("*.py")}
    assert rooms == {*ROOMS, *SHARED, "__init__"}


def test_no_file_has_more_than_500_lines():
    lines = {path: path.read_text(encoding="utf-8").count("\n") for path in ROOT.rglob("*.py")}
    assert {path.name: n for path, n in lines.items() if n > 500} == {}


@pytest.mark.parametrize("room", LINES)
def test_a_room_keeps_its_size(room):
    """Who needs more than 3 % more changes the number in the same commit, and says why there."""
    folder = ROOT / room if (ROOT / room).is_dir() else ROOT.parent / room
    if not folder.is_dir():
        pytest.skip("a checkout is needed")
    paths = folder.glob("*.rst") if room == "docs" else folder.rglob("*.py")
    texts = (path.read_text(encoding="utf-8") for path in paths)
    n = sum(text.count("\n") for text in texts)
    assert 0.9 * LINES[room] < n <= 1.03 * LINES[room]


def test_no_two_rooms_import_each_other():
    rooms, seen = SHARED | ROOMS, set()
    while len(seen) < len(rooms):
        free = {room for room, below in rooms.items() if below <= seen} - seen
        assert free, f"a circle among {sorted(set(rooms) - seen)}"
        seen |= free


def test_private_scikit_learn_is_touched_in_one_file_only():
    private = ("sklearn.utils._", "import _fit_context", "import _check_")
    for path in ROOT.rglob("*.py"):
        if path.name != "_sklearn.py":
            text = path.read_text(encoding="utf-8")
            assert not any(statement in text for statement in private), path.name


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*_numba.py")), ids=lambda path: path.stem)
def test_constants_reach_kernels_as_arguments(path):
    """Compiled code keeps the value that a constant had. The cache depends on all files of
    kernels, and does not notice an edit elsewhere."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    imported = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module.startswith("sklearn_mcmd")
        if not node.module.endswith("_numba")
        for alias in node.names
    }
    constants = {name for name in imported if name.isupper()}
    assert not constants, f"{path.name} imports {sorted(constants)}: pass it as argument"

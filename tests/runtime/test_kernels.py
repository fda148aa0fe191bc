"""Compiled code that is kept on disk is taken only while all kernels are as they were."""

import importlib
import os
import subprocess
import sys

import numpy as np
import pytest

from sklearn_mcmd.runtime import _compiling, _kernels

SOURCE = """
from sklearn_mcmd.runtime._kernels import kernel

@kernel(cache=True)
def double(x):
    return 2 * x
"""


def n_compiled(name):
    """How often the function is compiled, not loaded, in a module that is imported afresh."""
    module = importlib.reload(importlib.import_module(name))
    assert module.double(3) == 6
    return sum(module.double.stats.cache_misses.values())


def test_where_numba_is_told_not_to_compile_python_runs():
    command = [sys.executable, "-c", SOURCE + "print(double(3))"]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    assert subprocess.check_output(command, env=environment, text=True) == "6\n"


def test_a_kernel_that_makes_arrays_compiles_only_if_it_says_so():
    @_kernels.kernel(cache=True, allocates=True)
    def ones(n):
        return np.ones(n)

    @_kernels.kernel(cache=True)
    def zeros(n):
        return np.zeros(n)

    assert ones(3).tolist() == [1, 1, 1]
    with pytest.raises(Exception, match="No implementation"):
        zeros(3)


def test_an_edit_of_any_kernel_lets_all_be_compiled_again(tmp_path, monkeypatch):
    (tmp_path / "kept_kernel.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    assert n_compiled("kept_kernel") == 1
    assert n_compiled("kept_kernel") == 0
    monkeypatch.setattr(_kernels, "ROOT", tmp_path)
    monkeypatch.setattr(_kernels, "_stamp", _kernels._stamp.__wrapped__)
    for content in ("LIMIT = 1", "LIMIT = 2"):
        (tmp_path / "another_numba.py").write_text(content)
        assert n_compiled("kept_kernel") == 1


@pytest.mark.parametrize(("kind", "left"), [("nbi", 0), ("nbc", 100)])
def test_damaged_files_are_compiled_again(kind, left, tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "damaged_kernel.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "damaged_kernel", raising=False)
    assert n_compiled("damaged_kernel") == 1
    (path,) = (tmp_path / "cache").rglob(f"*.{kind}")
    path.write_bytes(path.read_bytes()[:left])
    assert n_compiled("damaged_kernel") == 1
    assert n_compiled("damaged_kernel") == 0


USE = """
import sys
sys.path.insert(0, sys.argv[1])
import numpy as np
from sklearn_mcmd.runtime._compiling import compiled_function
number_parts = compiled_function("planes._explaining_numba", "number_parts")
assert number_parts(np.array([0, 0, 2], np.int32)).tolist() == [0, 0, 1]
compiled_function("planes._moments_numba", "farthest_of_neighborhoods")
print(sum(number_parts.stats.cache_misses.values()))
"""


@pytest.fixture
def copied(tmp_path):
    """A copy of the package that cannot be written, and a file "no", below which nothing can be."""
    (tmp_path / "no").touch()
    for folder in [_kernels.ROOT, *_kernels.ROOT.rglob("*/")]:
        if folder.name != "__pycache__":
            copy = tmp_path / "site" / folder.relative_to(_kernels.ROOT.parent)
            copy.mkdir(parents=True)
            (copy / "__pycache__").touch()  # a file: not even root can write into it
            for path in folder.glob("*.py"):
                (copy / path.name).write_bytes(path.read_bytes())
    return tmp_path / "site"


@pytest.mark.skipif(os.name == "nt", reason="HOME does not say where users keep caches")
@pytest.mark.parametrize(
    ("home", "compilations"),
    [pytest.param("home", 1, marks=pytest.mark.slow), ("no/h", 2)],
)
def test_a_package_that_cannot_be_written_keeps_its_code_elsewhere_or_compiles_each_time(
    home, compilations, copied, tmp_path
):
    """In the user's folder of caches, if there is a home."""
    (tmp_path / "home").mkdir()
    environment = {k: v for k, v in os.environ.items() if k[:5] not in ("NUMBA", "XDG_C")}
    environment |= {"HOME": str(tmp_path / home)}
    command = [sys.executable, "-c", USE, str(copied)]
    times = [
        subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert sum(int(done.stdout) for done in times) == compilations
    for done in times:
        assert done.stderr.count("Compiled code cannot be kept, so each run compiles anew") == (
            compilations - 1
        )


def test_an_error_that_is_no_full_folder_is_raised_without_a_warning(monkeypatch):
    def fail(module, name):
        raise RuntimeError("out of luck")

    monkeypatch.setattr(_compiling, "_load", fail)
    with pytest.raises(RuntimeError, match="out of luck"):
        _compiling.compiled_function("planes._explaining_numba", "join")

"""Compiled code that is kept on disk is taken only while all kernels are as they were."""

import importlib

import pytest

pytest.importorskip("numba")

from sklearn_mcmd.planes import _kernels

SOURCE = """
from sklearn_mcmd.planes._kernels import kernel

@kernel(cache=True)
def double(x):
    return 2 * x
"""


def n_compiled(name):
    """How often the function is compiled, not loaded, in a module that is imported afresh."""
    module = importlib.reload(importlib.import_module(name))
    assert module.double(3) == 6
    return sum(module.double.stats.cache_misses.values())


def test_an_edit_of_any_kernel_lets_all_be_compiled_again(tmp_path, monkeypatch):
    (tmp_path / "kept_kernel.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    assert n_compiled("kept_kernel") == 1
    assert n_compiled("kept_kernel") == 0
    monkeypatch.setattr(_kernels, "_stamp", lambda: "another version")
    assert n_compiled("kept_kernel") == 1


def test_the_stamp_is_of_the_text_of_all_kernels(tmp_path, monkeypatch):
    before = _kernels._stamp.__wrapped__()
    assert before == _kernels._stamp()
    (tmp_path / "a_numba.py").write_text("LIMIT = 1")
    monkeypatch.setattr(_kernels, "ROOT", tmp_path)
    first = _kernels._stamp.__wrapped__()
    (tmp_path / "a_numba.py").write_text("LIMIT = 2")
    assert len({before, first, _kernels._stamp.__wrapped__()}) == 3

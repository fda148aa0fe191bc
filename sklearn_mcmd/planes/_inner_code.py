"""Code of functions that only compiled functions call, without machine code of their own.

Before Numba compiles a function it compiles all that this one calls: it optimizes each, translates
it to machine code and links it into the caller, which is optimized and translated with it. What
lies four calls below a function that Python calls was translated five times. Four of these
translations were never run.

This uses parts of Numba that may change. So it is done with releases that were tried. With others
everything works as well, and the first use takes longer.
"""

import numba
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

__all__ = ["inner_options"]

# Releases of Numba that were tried, with results equal to the last bit. Those of 0.61 differed.
FIRST, LAST = (0, 62), (0, 68)


def inner_options(release=numba.__version__):
    """Options of `numba.njit` for functions that Python does not call."""
    options = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    if FIRST <= tuple(int(part) for part in release.split(".")[:2]) <= LAST:
        options["pipeline_class"] = InnerCompiler
    return options


class InnerCompiler(Compiler):
    """Numba's compiler, which leaves its result in `InnerCode`."""

    def define_pipelines(self):
        state = self.state
        state.library = InnerCode(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return super().define_pipelines()


class InnerCode(JITCodeLibrary):
    """LLVM's form of a function and of what it calls, for callers to optimize and translate."""

    def _optimize_final_module(self):
        pass

    def _finalize_final_module(self):
        self._finalized = True

    def get_pointer_to_function(self, name):
        self._ensure_finalized()
        return 0  # as of any function without a wrapper for Python

    @property
    def codegen(self):
        """Numba asks for it to store an address in machine code, which there is none of."""
        return self

    def set_env(self, name, environment):
        pass

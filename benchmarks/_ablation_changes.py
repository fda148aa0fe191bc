"""The changes that `ablation.py` makes, one at a time: of limits and steps."""

import importlib
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

FACTORS = (0.5, 0.8, 1.25, 2.0)


def scaled(default, factors, most=np.inf):
    """Label and value of a constant times each factor; counts stay whole. Of several values also
    every second one."""
    if isinstance(default, tuple):
        yield from ((f"x {f:g}", tuple(f * value for value in default)) for f in factors)
        yield "every 2nd", default[::2]
        return
    for factor in factors:
        value = default * factor
        yield (
            f"x {factor:g}",
            min(max(1, round(value)) if isinstance(default, int) else value, most),
        )


@dataclass(frozen=True)
class Limit:
    """A field of a record of limits, the value that switches its rule off, if there is one, and the
    most that it can be. Whoever makes the record gets another default."""

    module: str
    record: str
    name: str
    off: float | None = None
    most: float = np.inf

    def variants(self, factors):
        record = getattr(importlib.import_module(f"sklearn_mcmd.{self.module}"), self.record)
        changes = [*scaled(record._field_defaults[self.name], factors, self.most)]
        if self.off is not None:
            changes.append(("off", self.off))
        for label, value in changes:
            yield label, lambda value=value: changed(record, **{self.name: value})

    def __str__(self):
        return f"{self.record}.{self.name}"


@dataclass(frozen=True)
class Step:
    """A step of region growing, which is left out."""

    name: str

    def variants(self, factors):
        yield "off", lambda: without_steps(self.name)

    def __str__(self):
        return self.name


@contextmanager
def changed(record, **values):
    """Whoever makes a record of limits gets other defaults, meanwhile."""
    make, kept = record.__new__, record.__new__.__defaults__
    make.__defaults__ = tuple({**record._field_defaults, **values}.values())
    try:
        yield
    finally:
        make.__defaults__ = kept


def without_steps(*names):
    """Region growing leaves these steps out, meanwhile."""
    from sklearn_mcmd.segmentation._estimator import GrowthSteps

    return changed(GrowthSteps, **dict.fromkeys(names, False))

"""Errors and warnings that name parameters, for which the command line has other names."""

import sys
import warnings
from string import Template

OWN = ("sklearn_mcmd.", "sklearn.", "contextlib")  # modules between a warning and who called

OF_ONE = {"are": "is", "do": "does", "have": "has", "were": "was"}
OF_ONE |= {"are outliers": "is an outlier", "are edges": "is an edge"}


class _Message(Template):
    idpattern = "(?a:[_a-z][_a-z0-9]*=?)"


class _Worded(Exception):
    """A message with ``$name`` for a parameter, or ``$name=`` before its value.

    ``$name`` of the `fields` shows the value itself, which may be worded differently: a row.
    """

    def __init__(self, message, **fields):
        super().__init__(message)
        self.fields = fields

    def __str__(self):
        return self.worded(_in_python)

    def worded(self, word):
        """The message with ``word(name, value)`` for each name; the value is None if no field."""
        message = _Message(self.args[0])
        names = message.get_identifiers()
        return message.safe_substitute({name: word(name, self.fields.get(name)) for name in names})


class ParameterError(_Worded, ValueError):
    """A value that cannot be."""


class ParameterWarning(_Worded, UserWarning):
    """A value that may not be what was meant."""


def warn(message, **fields):
    """Give a `ParameterWarning`, as `warn_caller` does."""
    warn_caller(ParameterWarning(message, **fields))


def warn_caller(message, category=UserWarning):
    """Warn at the nearest line outside of this package and scikit-learn, however deep the work."""
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith(OWN):
        frame = frame.f_back
    known, place = frame.f_globals, (frame.f_code.co_filename, frame.f_lineno)
    registry = known.setdefault("__warningregistry__", {})
    warnings.warn_explicit(message, category, *place, known.get("__name__"), registry)


def counted(n, noun, verb="", *, of=None):
    """A number of things in words: 1 point, 2 points; 1 of 9 points is, if the verb is "are"."""
    part, whole = ("", n) if of is None else (f"{n:,} of ", of)
    return f"{part}{whole:,} {noun}{'' if whole == 1 else 's'} {agreed(n, verb)}".rstrip()


def agreed(n, verb):
    """What so many things do, from what several do."""
    return OF_ONE.get(verb, verb and f"{verb}s") if n == 1 else verb


def fixed(value, form):
    """A number with fixed decimals, or from 1e15 on, where float64 has no more digits, in short."""
    return f"{value:{form if abs(value) < 1e15 else '.6g'}}"


def _in_python(name, value):
    if name == "row":
        return f"row {value}"
    if name == "growth_neighbors=":  # of RegionGrowing, where the command line has two numbers
        return "n_neighbors="
    return name if value is None else f"{name}={value!r}"

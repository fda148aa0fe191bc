"""Errors and warnings that name parameters, for which the command line has other names."""

import sys
import warnings
from string import Template

OWN = ("sklearn_mcmd.", "sklearn.", "contextlib")  # modules between a warning and who called


class _Message(Template):
    idpattern = "(?a:[_a-z][_a-z0-9]*=?)"


class _Worded:
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
    frame, level = sys._getframe(1), 2
    while frame is not None and frame.f_globals.get("__name__", "").startswith(OWN):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)


def counted(n, noun):
    """A number of things in words: 1 point, 2 points."""
    return f"{n:,} {noun}{'s' * (n != 1)}"


def _in_python(name, value):
    if name == "row":
        return f"row {value}"
    if name == "growth_neighbors=":  # of RegionGrowing, where the command line has two numbers
        return "n_neighbors="
    return name if value is None else f"{name}={value!r}"

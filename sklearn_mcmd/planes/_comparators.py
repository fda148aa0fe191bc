"""Registered methods, which judge neighborhoods in place of a rule, by name."""

from dataclasses import fields

__all__ = ["register_comparator", "settle_comparator"]

_COMPARATORS: dict[str, type] = {}


def register_comparator(name, kind):
    """Register a method under a name that estimators accept.

    `kind` is a dataclass whose fields are the method's parameters. It has ``fit_sizes``,
    ``tables``, ``table_shape`` and ``usual_cutoff`` as ``sklearn_mcmd.baselines`` defines them. Its
    ``has_cutoff`` says whether it decides by itself which points are outliers.
    """
    _COMPARATORS[name] = kind


def settle_comparator(method, method_params=None):
    """The method with this name and its parameters; errors name what is unknown or wrong."""
    if method not in _COMPARATORS:
        raise ValueError(f"method={method!r} is none of {', '.join(sorted(_COMPARATORS))}.")
    kind, params = _COMPARATORS[method], dict(method_params or {})
    known = sorted(field.name for field in fields(kind))
    unknown = sorted(str(name) for name in params if name not in known)
    if unknown:
        raise ValueError(
            f"method_params has {', '.join(map(repr, unknown))}, unknown to method {method!r}; "
            f"it knows {', '.join(known)}."
        )
    return kind(**params)

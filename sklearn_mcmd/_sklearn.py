"""The only file that uses scikit-learn's private API.

``_fit_context``, ``_param_validation`` and ``_doc_link_*`` are private, but most packages built on
scikit-learn use them. If they move, only this file changes.
"""

from functools import cache
from inspect import get_annotations
from typing import Literal, get_args, get_origin

from sklearn.base import _fit_context as fit_context
from sklearn.utils._param_validation import (
    HasMethods,
    Interval,
    StrOptions,
    validate_parameter_constraints,
    validate_params,
)
from sklearn.utils.validation import _check_feature_names_in as check_feature_names_in

try:
    from sklearn.callback import CallbackSupportMixin
except ImportError:  # before 1.9

    class CallbackSupportMixin:  # type: ignore[no-redef]
        """Nothing: there are no callbacks."""


__all__ = [
    "CallbackSupportMixin",
    "DocLinkMixin",
    "HasMethods",
    "Interval",
    "StrOptions",
    "check_feature_names_in",
    "check_parameters",
    "checked",
    "fit_context",
    "validate_parameter_constraints",
]


def checked(**constraints):
    """Decorate a function whose arguments are checked, in the way of `validate_params`.

    Type hints tell which of them are words or flags, the name `random_state` what a seed is.
    """

    def decorate(function):
        told = {"random_state": ["random_state"]}
        for name, hint in get_annotations(function).items():
            if get_origin(hint) is Literal:
                told[name] = [StrOptions(set(get_args(hint)))]
            elif hint is bool:
                told[name] = ["boolean"]
        return validate_params(told | constraints, prefer_skip_nested_validation=True)(function)

    return decorate


def check_parameters(estimator):
    """Raise InvalidParameterError for a parameter of an estimator, or of one within it."""
    for one in (estimator, *estimator.get_params(deep=False).values()):
        if hasattr(one, "_validate_params"):
            one._validate_params()


class DocLinkMixin:
    """Lets the HTML form of an estimator link to its page of the API.

    The site is `documentation_site`. While there is none, there is no link: scikit-learn leaves out
    an empty one. Put it to the left of `BaseEstimator`.
    """

    _doc_link_module = "sklearn_mcmd"

    @property
    def _doc_link_template(self):
        site = documentation_site()
        return f"{site}/generated/{{page}}.html" if site else ""

    def _doc_link_url_param_generator(self):
        return {"page": public_name(type(self))}


@cache
def documentation_site():
    """Where the pages are: "Documentation" of [project.urls] in pyproject.toml, or ""."""
    from importlib.metadata import PackageNotFoundError, metadata

    try:
        urls = metadata("sklearn-mcmd").get_all("Project-URL") or []
    except PackageNotFoundError:  # a folder on the path that was not installed
        return ""
    named = dict(url.split(", ", 1) for url in urls)
    return named.get("Documentation", "").rstrip("/")


def public_name(estimator_class):
    """The name by which the API documents a class: from the package, or from a public module."""
    import sklearn_mcmd

    name, parts = estimator_class.__name__, estimator_class.__module__.split(".")
    if name in sklearn_mcmd.__all__:
        parts = parts[:1]
    return ".".join([*(part for part in parts if not part.startswith("_")), name])

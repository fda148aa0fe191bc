"""The only file that uses scikit-learn's private API.

``_fit_context``, ``_param_validation`` and ``_doc_link_*`` are private, but most packages built on
scikit-learn use them. If they move, only this file changes.
"""

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

__all__ = [
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
    """Lets the HTML form of an estimator link to its page of the API, by the name it has there.

    Put it to the left of `BaseEstimator`. A test holds that the site is that of pyproject.toml.
    """

    _doc_link_module = "sklearn_mcmd"
    _doc_link_template = "https://sklearn-mcmd.github.io/sklearn-mcmd/generated/{page}.html"

    def _doc_link_url_param_generator(self):
        import sklearn_mcmd

        name, parts = type(self).__name__, type(self).__module__.split(".")
        if name in sklearn_mcmd.__all__:
            parts = parts[:1]
        return {"page": ".".join([*(part for part in parts if not part.startswith("_")), name])}

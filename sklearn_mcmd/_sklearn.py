"""The only file that uses scikit-learn's private API.

``_fit_context`` and ``_param_validation`` are private, but most packages built on scikit-learn use
them. If they move, only this file changes.
"""

from sklearn.base import _fit_context as fit_context
from sklearn.utils._param_validation import (
    Interval,
    StrOptions,
    validate_params,
)
from sklearn.utils.validation import _check_feature_names_in as check_feature_names_in

try:
    from sklearn.callback import CallbackSupportMixin
except ImportError:  # before 1.9

    class CallbackSupportMixin:
        """Nothing: there are no callbacks."""


__all__ = [
    "CallbackSupportMixin",
    "Interval",
    "StrOptions",
    "check_feature_names_in",
    "fit_context",
    "validate_params",
]

"""The one place that touches scikit-learn's private API.

``_fit_context`` and ``_param_validation`` are private though every mature satellite
package uses them; if they move, only this file changes.
"""

from numbers import Integral, Real

from sklearn.base import _fit_context as fit_context
from sklearn.utils._param_validation import (
    Hidden,
    Interval,
    InvalidParameterError,
    Options,
    StrOptions,
    validate_params,
)

__all__ = [
    "Hidden",
    "Integral",
    "Interval",
    "InvalidParameterError",
    "Options",
    "Real",
    "StrOptions",
    "fit_context",
    "validate_params",
]

"""One page of HTML that shows point clouds in a browser, offline.

:func:`sklearn_mcmd.plotting.view` and ``mcmd view`` make it.
"""

from sklearn_mcmd.view._page import CloudPage

__all__ = ["CloudPage"]

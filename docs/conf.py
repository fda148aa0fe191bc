"""Sphinx configuration: numpydoc for docstrings, sphinx-gallery for examples/."""

import sys
from pathlib import Path

from sphinx.ext import autosummary
from sphinx_gallery.sorting import ExplicitOrder

import sklearn_mcmd
from sklearn_mcmd import _sklearn

HERE = Path(__file__).parent
sys.path.append(str(HERE))
import offline_inventories  # noqa: E402

# Estimators on pages of the gallery link to the API beside them, and not to a site.
_sklearn.DocLinkMixin._doc_link_template = "../../generated/{page}.html"

project = "sklearn_mcmd"
author = "The sklearn_mcmd developers"
copyright = "2026, The sklearn_mcmd developers"
release = version = sklearn_mcmd.__version__

extensions = [
    "constants_table",
    "live_page",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx.ext.mathjax",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
templates_path = ["_templates"]
exclude_patterns = ["_build"]
html_theme = "pydata_sphinx_theme"
html_title = "sklearn_mcmd"
html_theme_options = {
    "show_prev_next": False,
    "navigation_with_keys": False,
    "secondary_sidebar_items": {"**": ["page-toc"], "index": [], "benchmarks": []},
    "logo": {"text": html_title},
}
html_logo = html_favicon = "_static/logo.svg"
html_static_path = ["_static"]
html_css_files = ["gallery.css"]
html_copy_source = False
html_show_sphinx = False

toc_object_entries_show_parents = "hide"  # fit(), not RobustNormalEstimator.fit()
autosummary_generate = True
autodoc_typehints = "none"  # docstrings say the types, and link them
# The first sentence of a docstring does not end at "(Eq. 13)".
autosummary.WELL_KNOWN_ABBREVIATIONS += ("Eq.",)
numpydoc_show_class_members = False  # The template of a class shows them, with their docstrings.

# Types of parameters become links: those that numpydoc knows, those listed, and our own classes.
# Other words of a type, such as "of shape (n_samples,)", stay words.
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"
numpydoc_xref_aliases = {
    "bool": ":class:`python:bool`",
    **{name: f":obj:`~{name}`" for name in offline_inventories.dotted_names()},
    **{name: f":obj:`~sklearn_mcmd.{name}`" for name in sklearn_mcmd.__all__},
}

# Each site first; without a network, the names that these pages use.
intersphinx_mapping = offline_inventories.intersphinx_mapping(HERE / "_build" / "inventories")
intersphinx_timeout = 5

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "auto_examples",
    "backreferences_dir": "generated/backreferences",  # the front page shows six by their paths
    "subsection_order": ExplicitOrder(
        [
            f"../examples/{group}"
            for group in (
                "cleaning",
                "normals",
                "segments",
                "planes",
                "change",
                "pipelines",
                "papers",
            )
        ]
    ),
    "within_subsection_order": "gallery_order.ByUse",
    "filename_pattern": r"/plot_",
    "ignore_pattern": r"adjustment_paper\.py",
    "download_all_examples": False,
    "show_memory": False,
    # What scripts print is part of the answer; of what expressions return, only estimators are.
    "capture_repr": ("_repr_html_",),
    "show_signature": False,
    "min_reported_time": 1e9,
}

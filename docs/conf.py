"""Sphinx configuration: numpydoc for docstrings, sphinx-gallery for examples/."""

import sklearn_mcmd

project = "sklearn_mcmd"
author = "The sklearn_mcmd developers"
copyright = "2026, The sklearn_mcmd developers"
release = version = sklearn_mcmd.__version__

extensions = [
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build"]
html_theme = "pydata_sphinx_theme"
html_title = "sklearn_mcmd"
html_theme_options = {"show_prev_next": False, "navigation_with_keys": False}
html_copy_source = False
html_show_sphinx = False

autosummary_generate = True
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "auto_examples",
    "filename_pattern": r"/plot_",
    "ignore_pattern": r"adjustment_paper\.py",
    "download_all_examples": False,
    "show_memory": False,
    # What scripts print is part of the answer; what an expression returns is not.
    "capture_repr": (),
    "min_reported_time": 1e9,
}

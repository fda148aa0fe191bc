"""Inventories of other projects' documentation for builds that reach no network.

Intersphinx asks the site of each project for its inventory. Where a site does not answer, it reads
a small one that is written here: the names that our pages link to, and no others. Each name is
first looked up in the installed library, so that a misspelled one stops the build.
"""

import inspect
import zlib
from pathlib import Path
from pkgutil import resolve_name

SITES = {
    "joblib": "https://joblib.readthedocs.io/en/stable/",
    "matplotlib": "https://matplotlib.org/stable/",
    "numpy": "https://numpy.org/doc/stable/",
    "python": "https://docs.python.org/3/",
    "scipy": "https://docs.scipy.org/doc/scipy/",
    "sklearn": "https://scikit-learn.org/stable/",
}

# Python names by the page that describes them; $ stands for the name.
NAMES = {
    "joblib": {"generated/$.html#$": ["joblib.parallel_config"]},
    "matplotlib": {
        "api/_as_gen/$.html#$": ["matplotlib.axes.Axes"],
        "api/figure_api.html#$": ["matplotlib.figure.Figure"],
    },
    "numpy": {
        "reference/generated/$.html#$": ["numpy.loadtxt", "numpy.ndarray"],
        "reference/random/legacy.html#$": ["numpy.random.RandomState"],
    },
    "python": {
        "library/collections.abc.html#$": ["collections.abc.Callable"],
        "library/constants.html#$": ["False", "None", "True"],
        "library/functions.html#$": ["bool", "callable", "float", "int"],
        "library/os.html#$": ["os.PathLike"],
        "library/stdtypes.html#$": ["dict", "list", "str", "tuple"],
    },
    "scipy": {},
    "sklearn": {
        "modules/generated/$.html#$": [
            "sklearn.cluster.DBSCAN",
            "sklearn.covariance.EllipticEnvelope",
            "sklearn.datasets.make_blobs",
            "sklearn.decomposition.PCA",
            "sklearn.exceptions.ConvergenceWarning",
            "sklearn.linear_model.RANSACRegressor",
            "sklearn.metrics.accuracy_score",
            "sklearn.metrics.adjusted_rand_score",
            "sklearn.metrics.recall_score",
            "sklearn.model_selection.GroupKFold",
            "sklearn.neighbors.LocalOutlierFactor",
            "sklearn.pipeline.Pipeline",
            "sklearn.set_config",
            "sklearn.utils.Bunch",
            "sklearn.utils.metadata_routing.MetadataRequest",
        ],
    },
}

# Labels and glossary terms: numpydoc's words for types, and what inherited docstrings refer to.
WORDS = {
    "numpy": {"std:term array_like": "glossary.html#term-array_like"},
    "python": {
        "std:term iterable": "glossary.html#term-iterable",
        "std:term sequence": "glossary.html#term-sequence",
    },
    "sklearn": {
        "std:label df_output_transform": "modules/df_output_transform.html#df-output-transform",
        "std:label metadata_routing": "metadata_routing.html#metadata-routing",
        "std:label sphx_glr_auto_examples_miscellaneous_plot_set_output.py": (
            "auto_examples/miscellaneous/plot_set_output.html"
        ),
        "std:term meta-estimator": "glossary.html#term-meta-estimator",
    },
}


def intersphinx_mapping(folder):
    """Where intersphinx looks for each project: its site, then the file written to `folder`."""
    folder = Path(folder).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    mapping = {}
    for project, site in SITES.items():
        file = folder / f"{project}.inv"
        file.write_bytes(_inventory(project))
        mapping[project] = site, (None, str(file))
    return mapping


def dotted_names():
    """Names with a dot, which become links where a docstring gives them as a type."""
    names = [name for pages in NAMES.values() for names in pages.values() for name in names]
    return [name for name in names if "." in name]


def _inventory(project):
    """An inventory in Sphinx's format, version 2: four lines of text, then compressed lines."""
    lines = [
        f"{name} py:{_role(name)} 1 {page.replace('$', name)} -"
        for page, names in NAMES[project].items()
        for name in names
    ]
    for word, page in WORDS.get(project, {}).items():
        role, name = word.split(" ")
        lines.append(f"{name} {role} -1 {page} {name}")
    head = f"# Sphinx inventory version 2\n# Project: {project}\n# Version: \n"
    head += "# The remainder of this file is compressed using zlib.\n"
    return head.encode() + zlib.compress("\n".join(lines).encode())


def _role(name):
    thing = resolve_name(name if "." in name else f"builtins:{name}")
    if inspect.isclass(thing):
        return "exception" if issubclass(thing, BaseException) else "class"
    return "function" if callable(thing) else "data"

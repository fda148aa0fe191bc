"""The order of examples within a group of the gallery: the most useful first."""

from sphinx_gallery.sorting import FileNameSortKey

FIRST = (
    "plot_clean_street.py",
    "plot_las_report.py",
    "plot_outlier_strictness.py",
    "plot_check_before.py",
    "plot_compare_detectors.py",
    "plot_tiles.py",
    "plot_trusted_neighbors.py",
    "plot_street_normals.py",
    "plot_choose_k.py",
    "plot_curvature.py",
    "plot_name_segments.py",
    "plot_machined_part.py",
    "plot_pipeline_segments.py",
    "plot_pipeline_blocks.py",
    "plot_own_method.py",
    "plot_grid_search.py",
    "plot_dask_cluster.py",
)


class ByUse(FileNameSortKey):
    """Files of `FIRST` in its order, then all others by name."""

    def __call__(self, filename):
        known = filename in FIRST
        return not known, FIRST.index(filename) if known else 0, filename

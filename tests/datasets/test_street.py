"""The street: statistics against their laws, truth against brute force."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree
from scipy.stats import kstest

from reference import pca_normal
from scenes import scene_of
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.datasets._street import _street
from sklearn_mcmd.datasets._surfaces import Patch
from sklearn_mcmd.metrics import bias_angle


@pytest.fixture(scope="module")
def street():
    return make_street(
        30_000, spacing=0.07, noise_growth=4, spacing_growth=2, tree=True, random_state=0
    )


def test_every_array_has_a_row_per_point_and_the_documented_type(street):
    types = {
        "data": "f8",
        "target": "i8",
        "true_points": "f8",
        "normals": "f8",
        "surface": "i8",
        "bay": "i8",
        "edge_distance": "f8",
        "outlier_kind": "i1",
        "noise_scale": "f8",
    }
    for name, kind in types.items():
        assert street[name].dtype == np.dtype(kind), name
        wide = name in ("data", "true_points", "normals")
        assert street[name].shape == ((30_000, 3) if wide else (30_000,)), name


def test_points_without_noise_lie_on_the_scene(street):
    regular = street.target == 1
    distance = scene_of(street, tree=True).distance(street.true_points[regular])
    assert_allclose(distance, 0, atol=1e-9)


def test_points_without_noise_lie_on_the_surface_and_bay_that_they_are_labelled_with(street):
    scene = scene_of(street, tree=True)
    for number, part in enumerate(scene.parts):
        mine = street.surface == number
        local = street.true_points[mine] - np.outer(
            street.bay[mine] * scene.bay_length, [1.0, 0, 0]
        )
        assert_allclose(part.distance(local), 0, atol=1e-9)


def test_sensor_origins_are_the_scanner_of_each_bay(street):
    regular = street.target == 1
    scanners = np.unique(street.sensor_origins, axis=0)
    assert len(scanners) == street.bay.max() + 1 > 2
    assert_array_equal(street.sensor_origins[regular], scanners[street.bay[regular]])
    nearest = cKDTree(scanners[:, :1]).query(street.data[~regular, :1])[1]
    assert_array_equal(street.sensor_origins[~regular], scanners[nearest])


def test_mixed_pixels_lie_on_rays_of_their_sensor_origin():
    street = make_street(6000, spacing=0.15, outlier_kinds=["mixed_pixel"], random_state=0)
    scene = scene_of(street)
    mixed = street.target == -1
    way = (street.data - street.sensor_origins)[mixed]
    local = street.sensor_origins[mixed] - scene.scanner
    assert len(np.unique(local[:, 0])) > 2
    # The ray is free up to the point, and meets a background behind it.
    assert (scene.first_hit(scene.scanner + 0.999 * way) == np.inf).all()
    assert np.isfinite(scene.first_hit(scene.scanner + 10 * way)).all()


def test_data_without_noise_are_the_true_points():
    street = make_street(2000, noise=0, outlier_share=0, random_state=0)
    assert_array_equal(street.data, street.true_points)


def test_noise_does_not_move_the_true_points():
    quiet, loud = (make_street(2000, noise=s, random_state=0) for s in (0.0, 0.02))
    regular = quiet.target == 1
    assert_array_equal(quiet.true_points[regular], loud.true_points[regular])


def test_noise_is_gaussian_with_the_scale_of_each_point(street):
    regular = street.target == 1
    noise = (street.data - street.true_points)[regular] / street.noise_scale[regular, None]
    for column in noise.T:
        assert kstest(column, "norm").pvalue > 1e-3


def test_noise_grows_linearly_with_the_range_to_the_scanner(street):
    regular = street.target == 1
    ranges = np.linalg.norm(street.true_points[regular] - street.sensor_origins[regular], axis=1)
    scale = street.noise_scale[regular]
    # A straight line from 0.005 at the nearest point to nearly 0.02 at the farthest.
    slope, start = np.polyfit(ranges, scale, 1)
    assert_allclose(scale, start + slope * ranges, rtol=1e-6)
    assert scale.min() == pytest.approx(0.005, rel=0.02)
    assert 0.017 < scale.max() <= 0.02


def test_outliers_rows_say_that_they_have_no_truth(street):
    outlier = street.target == -1
    assert outlier.sum() == 3000
    assert (street.surface[outlier] == -1).all()
    assert (street.bay[outlier] == -1).all()
    for name in ("normals", "true_points", "edge_distance"):
        assert np.isnan(street[name][outlier]).all()
    assert_array_equal(street.outlier_kind > 0, outlier)


def test_only_foliage_lacks_normals_and_edges_among_the_regular_points(street):
    foliage = street.surface == street.surface_names.index("foliage")
    assert foliage.sum() > 500
    assert (street.target[foliage] == 1).all()
    regular = street.target == 1
    assert_array_equal(np.isnan(street.normals[regular]).all(axis=1), foliage[regular])
    assert_array_equal(np.isnan(street.edge_distance[regular]), foliage[regular])


def test_normals_are_unit_vectors_towards_the_scanner(street):
    has = ~np.isnan(street.edge_distance)
    assert_allclose(np.linalg.norm(street.normals[has], axis=1), 1, rtol=1e-12)
    view = street.sensor_origins[has] - street.true_points[has]
    assert (np.einsum("ij,ij->i", street.normals[has], view) > 0).all()


def test_normals_agree_with_planes_fitted_to_dense_noise_free_neighbors():
    street = make_street(60_000, noise=0, outlier_share=0, random_state=1)
    inside = np.flatnonzero(street.edge_distance > 0.2)[:300]
    neighbors = cKDTree(street.data).query(street.data[inside], k=12)[1]
    fitted = np.array([pca_normal(street.data[row]) for row in neighbors])
    angles = bias_angle(fitted, street.normals[inside])
    assert np.median(angles) < 0.1
    assert np.quantile(angles, 0.9) < 10  # poles curve within a neighborhood


def edge_points(part, n=400):
    """Dense points on all sharp edges of a part."""
    rng = np.random.default_rng(0)
    points = [np.empty((0, 3))]
    if isinstance(part, Patch):
        points.append(part.sample_outline(20 * n, rng, None))
    for circle in getattr(part, "circles", ()):
        across = np.linalg.svd(circle.axis[None])[2][1:]
        angle = np.linspace(0, 2 * np.pi, n)
        ring = np.column_stack([np.cos(angle), np.sin(angle)]) @ across
        points.append(circle.center + circle.radius * ring)
    return np.concatenate(points)


def test_every_edge_touches_another_surface_or_is_a_free_rim():
    parts = _street(5.0, 1, True).parts
    free = {"sign", "sign_post", "lamp_pole", "trunk"}
    for part in parts:
        points = edge_points(part)
        others = np.min([p.distance(points) for p in parts if p is not part], axis=0)
        touching = others < 1e-9
        assert touching.all() or part.name in free, part.name


def test_wherever_two_surfaces_meet_both_have_an_edge():
    parts = [p for p in _street(5.0, 1, True).parts if p.name != "foliage"]
    rng = np.random.default_rng(12)
    met = 0
    for part in parts:
        points = part.sample(30_000, rng)
        for other in parts:
            if other is part:
                continue
            near = points[other.distance(points) < 0.01]
            # Surfaces at right angles: 1 cm from the other is 1 cm from the edge or, at a
            # corner, less than twice that; inside a pole's foot no point is ever seen.
            feet = [c for c in getattr(part, "circles", ()) if isinstance(part, Patch)]
            for foot in feet:
                away = np.linalg.norm(near - foot.center, axis=1) > foot.radius
                near = near[away]
            if len(near):
                met += 1
                assert part.edge_distance(near).max() < 0.02, (part.name, other.name)
    assert met > 40


def test_edge_distances_of_a_long_street_see_the_next_bay():
    street = make_street(40_000, spacing=0.06, outlier_share=0, noise=0, random_state=2)
    n_bays = street.bay.max() + 1
    length = street.length / n_bays
    assert n_bays > 2
    wall = street.surface_names.index("wall")
    mine = street.surface == wall
    one_bay = edge_points(scene_of(street).parts[wall])
    shifts = np.outer(np.arange(n_bays) * length, [1.0, 0, 0])
    edges = (one_bay + shifts[:, None]).reshape(-1, 3)
    brute = cKDTree(edges).query(street.true_points[mine])[0]
    # 8000 random points on 14 m of edges leave gaps of a few centimeters at most.
    assert_allclose(street.edge_distance[mine], brute, atol=0.02)
    assert (street.edge_distance[mine] <= brute + 1e-9).all()


def test_the_lamp_pole_casts_a_shadow_on_the_wall_and_no_point_lies_in_it():
    street = make_street(50_000, noise=0, outlier_share=0, random_state=3)
    behind = np.isin(street.surface, [street.surface_names.index(n) for n in ("wall", "footpath")])
    scanner, points = street.sensor_origins[0, :2], street.true_points[behind]
    way = points[:, :2] - scanner
    pole = np.array([3.6, 3.45]) - scanner
    share = np.clip(way @ pole / (way * way).sum(axis=1), 0, 1)
    miss = np.linalg.norm(share[:, None] * way - pole, axis=1)
    assert miss.min() > 0.09 - 1e-6
    assert miss.min() < 0.095
    # The shadow on the wall is as wide as the pole, twice as far away.
    on_wall = np.sort(points[points[:, 2] > 0.5, 0])
    assert np.diff(on_wall[on_wall > 3.2]).max() > 0.2


def test_the_spacing_on_the_road_is_the_one_asked():
    street = make_street(60_000, spacing=0.04, outlier_share=0, noise=0, random_state=4)
    assert street.spacing == pytest.approx(0.04, rel=0.01)
    x, y, _ = street.data[street.surface == 0].T
    # An open rectangle of the road, without shadows; the camber adds under 0.1 % of area.
    window = (x > 1) & (x < street.length - 1) & (y > 0.5) & (y < 2.5)
    expected = 2 * (street.length - 2) / 0.04**2
    assert window.sum() == pytest.approx(expected, abs=5 * np.sqrt(expected) + 0.01 * expected)


def test_the_spacing_grows_with_the_range_as_asked():
    street = make_street(
        100_000, spacing_growth=3, noise_growth=3, noise=1e-3, outlier_share=0, random_state=5
    )
    x, y, _ = street.true_points[street.surface == 0].T
    relative = street.noise_scale[street.surface == 0] / 1e-3
    counts = []
    for x0 in np.arange(0, 5, 0.5):
        window = (x >= x0) & (x < x0 + 0.5) & (y > 1) & (y < 1.5)
        expected = 0.25 / (street.spacing * relative[window]) ** 2
        counts.append((window.sum(), expected.mean()))
    found, expected = np.array(counts).T
    assert_allclose(found, expected, atol=5 * np.sqrt(expected.max()), rtol=0.02)
    assert found.max() > 2 * found.min()


def test_no_outlier_lies_within_four_noise_scales_of_a_surface_or_in_foliage(street):
    outlier = street.target == -1
    distance = scene_of(street, tree=True).distance(street.data[outlier])
    assert (distance > 4 * street.noise_scale[outlier]).all()


def test_the_bays_of_a_long_street_are_shared_evenly():
    street = make_street(60_000, spacing=0.05, outlier_share=0, random_state=12)
    counts = np.bincount(street.bay)
    assert len(counts) == len(np.unique(street.sensor_origins, axis=0)) > 3
    assert np.abs(counts - counts.mean()).max() < 5 * np.sqrt(counts.mean())
    assert street.true_points[:, 0].max() <= street.length


def test_rows_are_shuffled():
    street = make_street(2000, random_state=15)
    assert 0 < (street.target[:200] == -1).sum() < 60


def test_streets_are_reproducible_and_differ_between_seeds():
    first, again, other = (make_street(1000, random_state=s) for s in (0, 0, 1))
    for name in ("data", "normals", "noise_scale", "outlier_kind"):
        assert_array_equal(first[name], again[name])
    assert not np.isin(first.data, other.data).any()


@pytest.mark.parametrize("n_samples", [1, 2, 10, 101])
def test_small_streets_have_as_many_points_as_asked(n_samples):
    street = make_street(n_samples, outlier_share=0.4, random_state=0)
    assert len(street.data) == n_samples
    assert (street.target == -1).sum() == round(0.4 * n_samples)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"outlier_kinds": ["rain"]}, r"outlier_kinds=\['rain'\] must name"),
        ({"outlier_kinds": ["ghost", "ghost"]}, "once each"),
        ({"outlier_kinds": []}, "outlier_share=0"),
        ({"outlier_kinds": "ghost"}, "'outlier_kinds' parameter"),
        ({"outlier_share": 1.0}, "'outlier_share' parameter"),
        ({"n_samples": 1, "outlier_share": 0.9}, "leaves no regular point"),
        ({"noise": -0.1}, "'noise' parameter"),
        ({"noise": np.nan}, "'noise' parameter"),
        ({"noise_growth": 0.5}, "'noise_growth' parameter"),
        ({"spacing": 0.0}, "'spacing' parameter"),
        ({"spacing": 0.01}, "n_samples is too small for spacing=0.01"),
        ({"noise": 2.0}, "noise leaves no room"),
    ],
)
def test_bad_parameters_of_the_street_are_named(parameters, message):
    with pytest.raises(ValueError, match=message):
        make_street(**({"n_samples": 5000} | parameters))

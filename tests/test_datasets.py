"""Made-up clouds: statistics against their laws, truth against brute force."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree
from scipy.stats import kstest

from sklearn_mcmd.datasets import make_contaminated_plane, make_street
from sklearn_mcmd.datasets._outliers import _cluster_sizes
from sklearn_mcmd.datasets._panels import Bilinear, Disc, Polygon
from sklearn_mcmd.datasets._scene import Scene
from sklearn_mcmd.datasets._street import _street
from sklearn_mcmd.datasets._surfaces import Circle, Cylinder, Foliage, Patch
from sklearn_mcmd.metrics import bias_angle

# --- The plane of Section 5.1 ----------------------------------------------------------------


def pca_normal(X):
    return np.linalg.eigh(np.cov(X.T))[1][:, 0]


def test_regular_points_have_the_means_and_variances_of_section_5_1():
    X, y = make_contaminated_plane(40_000, outlier_share=0.5, random_state=0)
    regular = X[y == 1]
    variances = np.array([6, 6, 0.01])
    # Five standard errors: of a mean sqrt(v/n), of a variance v sqrt(2/n).
    assert (np.abs(regular.mean(axis=0) - 2) < 5 * np.sqrt(variances / 20_000)).all()
    assert_allclose(regular.var(axis=0), variances, rtol=5 * np.sqrt(2 / 20_000))


def test_clustered_outliers_have_the_means_and_variances_of_section_5_1():
    X, y = make_contaminated_plane(40_000, outlier_share=0.5, random_state=1)
    variances = np.array([2, 2, 1.5])
    error = np.abs(X[y == -1].mean(axis=0) - [7, 6, 8])
    assert (error < 5 * np.sqrt(variances / 20_000)).all()
    assert_allclose(X[y == -1].var(axis=0), variances, rtol=5 * np.sqrt(2 / 20_000))


def test_uniform_outliers_fill_their_range_on_every_axis():
    X, y = make_contaminated_plane(
        10_000, outlier_share=0.5, outliers="uniform", uniform_range=(-9, 9), random_state=2
    )
    for column in X[y == -1].T:
        assert kstest(column, "uniform", args=(-9, 18)).pvalue > 1e-3


@pytest.mark.parametrize(
    ("outliers", "paper_mean", "paper_std"),
    [("clustered", 34.483, 3.973), ("uniform", 27.593, 16.231)],
)
def test_pca_has_the_bias_angle_of_table_1(outliers, paper_mean, paper_std):
    clouds = [
        make_contaminated_plane(outliers=outliers, return_X_y=False, random_state=seed)
        for seed in range(1000)
    ]
    angles = [bias_angle(pca_normal(c.data), pca_normal(c.clean)) for c in clouds]
    # Both means come from 1000 runs: four standard errors of their difference.
    assert abs(np.mean(angles) - paper_mean) < 4 * paper_std * np.sqrt(2 / 1000)
    assert_allclose(np.std(angles), paper_std, rtol=0.15)


@pytest.mark.parametrize("shuffle", [False, True])
def test_the_clean_twin_differs_exactly_where_the_outliers_are(shuffle):
    cloud = make_contaminated_plane(shuffle=shuffle, return_X_y=False, random_state=3)
    assert_array_equal((cloud.data != cloud.clean).all(axis=1), cloud.target == -1)
    assert_array_equal((cloud.data != cloud.clean).any(axis=1), cloud.target == -1)


def test_the_clean_twin_has_the_regular_law_at_replaced_rows_too():
    cloud = make_contaminated_plane(20_000, outlier_share=0.5, return_X_y=False, random_state=4)
    replaced = cloud.clean[cloud.target == -1]
    assert_allclose(replaced.var(axis=0), [6, 6, 0.01], rtol=5 * np.sqrt(2 / 10_000))


def test_outliers_come_last_unless_shuffled():
    assert_array_equal(make_contaminated_plane(random_state=0)[1], np.repeat([1, -1], [40, 10]))
    assert (make_contaminated_plane(shuffle=True, random_state=0)[1][:40] == -1).any()


@pytest.mark.parametrize("n_samples", [20, 50, 100, 1000, 10_000])
@pytest.mark.parametrize("percent", [1, 5, 20, 45, 50, 80])
def test_the_number_of_outliers_is_the_nearest_to_the_share(n_samples, percent):
    X, y = make_contaminated_plane(n_samples, outlier_share=percent / 100, random_state=0)
    assert X.shape == (n_samples, 3)
    assert abs((y == -1).sum() - percent * n_samples / 100) <= 0.5


@pytest.mark.parametrize("variances", [(2, 1), (6, 2), (8, 4), (10, 6), (12, 8), (15, 10)])
def test_the_variances_of_table_2_can_be_made(variances):
    regular, outlier = variances
    X, y = make_contaminated_plane(
        20_000,
        outlier_share=0.5,
        regular_variances=(regular, regular, 0.01),
        outlier_variances=(outlier, outlier, 1.5),
        random_state=5,
    )
    assert_allclose(X[y == 1, :2].var(axis=0), regular, rtol=5 * np.sqrt(2 / 10_000))
    assert_allclose(X[y == -1, :2].var(axis=0), outlier, rtol=5 * np.sqrt(2 / 10_000))


def test_a_larger_share_replaces_points_and_leaves_the_others():
    few = make_contaminated_plane(100, outlier_share=0.1, random_state=6)[0]
    many = make_contaminated_plane(100, outlier_share=0.4, random_state=6)[0]
    assert_array_equal(few[:60], many[:60])


def test_the_normal_is_the_axis_of_least_variance_in_any_dimension():
    cloud = make_contaminated_plane(
        outliers="uniform",
        regular_mean=np.zeros(4),
        regular_variances=(1, 0.1, 2, 3),
        return_X_y=False,
    )
    assert_array_equal(cloud.normal, [0, 1, 0, 0])
    assert cloud.data.shape == (50, 4)


def test_planes_are_reproducible_and_differ_between_seeds():
    first, again, other = (make_contaminated_plane(random_state=s)[0] for s in (0, 0, 1))
    assert_array_equal(first, again)
    assert (first != other).all()


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"outliers": "none"}, "'outliers' parameter"),
        ({"outlier_share": 1.2}, "'outlier_share' parameter"),
        ({"n_samples": 0}, "'n_samples' parameter"),
        ({"regular_variances": (1, 1, -1)}, "regular_variances=.*not negative"),
        ({"regular_variances": (1, 1, 1)}, "no single least value"),
        ({"regular_mean": (1, 1)}, "regular_mean has shape"),
        ({"outlier_mean": (1, 1), "outlier_variances": (1, 1)}, "outlier_mean has 2 coordinates"),
        ({"outliers": "uniform", "uniform_range": (9, -9)}, "uniform_range=.*increasing"),
        ({"regular_mean": (1, 1, np.nan)}, "regular_mean=.*finite"),
    ],
)
def test_bad_parameters_of_the_plane_are_named(parameters, message):
    with pytest.raises(ValueError, match=message):
        make_contaminated_plane(**parameters)


# --- The parts of a scene ---------------------------------------------------------------------

PARTS = {
    "patch": Patch("patch", (1, 2, 3), (0.6, 0.8, 0), (-1.6, 1.2, 0)),
    "patch with holes": Patch(
        "wall",
        (0, 1, 0),
        (4, 0, 0),
        (0, 0, 2),
        holes=[(0.5, 1.5, 0.5, 1.5), (2.5, 3.2, 0, 1.2)],
        smooth=("u0", "v1"),
    ),
    "cylinder": Cylinder("pole", (1, 1, 0), (0.5, 0, 2), 0.3),
    "arc": Cylinder("arc", (0, 0, 0), (2, 0, 0), 1.5, start=(0, 0, 1), arc=1.0, sharp=("stop",)),
    "polygon": Polygon("kite", [(0, 0, 0), (1, 0, 0.5), (1.2, 1, 0.6), (0.3, 1.4, 0.15)]),
    "disc": Disc("lid", (1, 2, 3), (1, -2, 2), 0.8),
    "ring": Disc("ring", (1, 2, 3), (0, -1, 1), 0.9, inner=0.4),
    "bilinear": Bilinear("roof", [(0, 0, 0), (1, 0, 0.8), (1.1, 1.2, 0), (0, 1, 0.9)]),
    "flat bilinear": Bilinear("floor", [(0, 0, 1), (1.5, 0, 1), (1, 1, 1), (0, 0.5, 1)]),
}
#: Hand-written ends of the sharp straight edges of the patch with holes.
WALL_EDGES = [
    ((0, 1, 0), (2.5, 1, 0)),
    ((3.2, 1, 0), (4, 1, 0)),
    ((4, 1, 0), (4, 1, 2)),
    ((0.5, 1, 0.5), (1.5, 1, 0.5)),
    ((0.5, 1, 1.5), (1.5, 1, 1.5)),
    ((0.5, 1, 0.5), (0.5, 1, 1.5)),
    ((1.5, 1, 0.5), (1.5, 1, 1.5)),
    ((2.5, 1, 0), (2.5, 1, 1.2)),
    ((3.2, 1, 0), (3.2, 1, 1.2)),
    ((2.5, 1, 1.2), (3.2, 1, 1.2)),
]

each_part = pytest.mark.parametrize("part", PARTS.values(), ids=PARTS.keys())


def along(edges, n=4001):
    """Dense points on straight edges."""
    share = np.linspace(0, 1, n)[:, None]
    return np.concatenate([np.array(a) + share * (np.array(b) - a) for a, b in edges])


@each_part
def test_samples_of_a_part_lie_on_it(part):
    points = part.sample(2000, np.random.default_rng(0))
    assert_allclose(part.distance(points), 0, atol=1e-12)


@each_part
def test_samples_lie_within_the_bounds_and_reach_them(part):
    points = part.sample(20_000, np.random.default_rng(0))
    assert_allclose(points.min(axis=0), part.bounds[0], atol=0.03)
    assert_allclose(points.max(axis=0), part.bounds[1], atol=0.03)
    assert (points >= part.bounds[0] - 1e-6).all()
    assert (points <= part.bounds[1] + 1e-6).all()


@each_part
def test_the_distance_to_a_part_is_that_to_a_dense_sample_of_it(part):
    rng = np.random.default_rng(1)
    sample = part.sample(400_000, rng)
    queries = rng.uniform(part.bounds[0] - 1, part.bounds[1] + 1, (500, 3))
    brute = cKDTree(sample).query(queries)[0]
    exact = part.distance(queries)
    assert (brute >= exact - 1e-9).all()
    # 400 000 points on 7 m^2 or less leave holes of up to 2 cm (corners are the worst).
    assert_allclose(exact, brute, atol=0.02)


@each_part
def test_a_step_along_the_normal_is_the_distance_from_the_part(part):
    points = part.sample(1000, np.random.default_rng(2))
    normals = part.normals(points)
    assert_allclose(np.linalg.norm(normals, axis=1), 1, rtol=1e-12)
    assert_allclose(part.distance(points + 0.01 * normals), 0.01, rtol=1e-9)


def test_samples_are_uniform_over_the_cells_of_a_patch_with_holes():
    part = PARTS["patch with holes"]
    points = part.sample(100_000, np.random.default_rng(3))
    assert part.area == pytest.approx(8 - 1 - 0.84)
    left = (points[:, 0] < 0.5).mean()
    assert left == pytest.approx(1 / 6.16, abs=5 * np.sqrt(0.16 * 0.84 / 1e5))


def test_edges_of_a_patch_with_holes_are_those_written_by_hand():
    part = PARTS["patch with holes"]
    points = part.sample(2000, np.random.default_rng(4))
    brute = cKDTree(along(WALL_EDGES)).query(points)[0]
    # The dense points are 1 mm apart or less: at most half of it off, and never nearer.
    assert_allclose(part.edge_distance(points), brute, atol=5e-4)
    assert (part.edge_distance(points) <= brute + 1e-12).all()
    assert part.outline_length == pytest.approx(2.5 + 0.8 + 2 + 4 + 2.4 + 0.7)


def test_a_pole_has_its_circles_and_an_arc_its_side_as_edges():
    pole = Cylinder("pole", (0, 0, 1), (0, 0, 2), 0.3)
    points = pole.sample(500, np.random.default_rng(5))
    height = points[:, 2] - 1
    assert_allclose(pole.edge_distance(points), np.minimum(height, 2 - height), atol=1e-12)
    arc = PARTS["arc"]
    points = arc.sample(500, np.random.default_rng(6))
    # The arc runs from z right-handed around x, that is towards -y.
    side = 1.5 * np.array([-np.sin(1.0), np.cos(1.0)])
    assert_allclose(arc.edge_distance(points), np.linalg.norm(points[:, 1:] - side, axis=1))


def test_the_distance_to_a_circle_is_that_to_a_dense_sample_of_it():
    circle = Circle((1, 2, 3), (0, 0, 2), 0.5)
    angle = np.linspace(0, 2 * np.pi, 20_000)
    ring = np.column_stack([1 + 0.5 * np.cos(angle), 2 + 0.5 * np.sin(angle), np.full(20_000, 3)])
    queries = np.random.default_rng(7).uniform(0, 4, (300, 3))
    assert_allclose(circle.distance(queries), cKDTree(ring).query(queries)[0], atol=1e-4)


@each_part
def test_rays_meet_a_part_where_its_distance_is_zero_and_nowhere_before(part):
    rng = np.random.default_rng(8)
    low, high = part.bounds
    origin = (low + high) / 2 + np.array([0.7, -2.5, 1.9])
    ends = origin + 2.5 * (rng.uniform(low - 0.2, high + 0.2, (400, 3)) - origin)
    fraction = part.hit(origin, ends)
    hits = np.isfinite(fraction)
    assert 50 < hits.sum() < 400
    met = origin + fraction[hits, None] * (ends - origin)[hits]
    assert_allclose(part.distance(met), 0, atol=1e-9)
    # Sphere tracing: steps shorter than the distance never jump over a surface.
    travelled = np.zeros(400)
    lengths = np.linalg.norm(ends - origin, axis=1)
    for _ in range(500):
        traced = travelled / lengths
        step = 0.99 * part.distance(origin + traced[:, None] * (ends - origin))
        travelled += np.where(step > 1e-9, step, 0)  # arrived: rounding must not push it through
        np.minimum(travelled, 1.01 * lengths, out=travelled)
    # Rays that graze a border creep, so a few misses have not reached their ends yet.
    assert_allclose(traced[hits], fraction[hits], atol=1e-3)
    assert (traced[~hits] > 1).mean() > 0.98


def test_outline_points_of_a_pole_are_where_the_rays_touch_it():
    pole = Cylinder("pole", (1, 2, 0), (0, 0, 3), 0.2)
    viewpoint = np.array([-2.0, 0.5, 1.5])
    outline = pole.sample_outline(200, np.random.default_rng(9), viewpoint)
    assert_allclose(pole.distance(outline), 0, atol=1e-12)
    across = np.einsum("ij,ij->i", pole.normals(outline), viewpoint - outline)
    assert_allclose(across, 0, atol=1e-12)


def test_foliage_fills_its_ball_evenly_and_has_no_normal_or_edge():
    ball = Foliage("foliage", (1, 2, 3), 0.7)
    points = ball.sample(5000, np.random.default_rng(10))
    reach = np.linalg.norm(points - [1, 2, 3], axis=1) / 0.7
    assert kstest(reach**3, "uniform").pvalue > 1e-3
    assert np.isnan(ball.normals(points)).all()
    assert np.isnan(ball.edge_distance(points)).all()
    assert_allclose(ball.distance(np.array([[1, 2, 4.0], [1, 2, 3.1]])), [0.3, 0])


def test_distances_over_bays_are_the_least_over_all_copies():
    parts = [Patch("plate", (0.1, 0, 0), (0.3, 0, 0), (0, 0, 1)), PARTS["cylinder"]]
    scene = Scene(parts, 2.0, 4, (1.0, -2, 1))
    queries = np.random.default_rng(11).uniform((-3, -3, -3), (11, 3, 3), (1000, 3))
    copies = [part.distance(queries - [2.0 * bay, 0, 0]) for part in parts for bay in range(4)]
    assert_allclose(scene.distance(queries), np.min(copies, axis=0), rtol=1e-12)


# --- The street -------------------------------------------------------------------------------


def scene_of(street, tree=False):
    n_bays = len(street.scanners)
    return _street(street.length / n_bays, n_bays, tree)


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
    ranges = np.linalg.norm(
        street.true_points[regular] - street.scanners[street.bay[regular]], axis=1
    )
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
    view = street.scanners[street.bay[has]] - street.true_points[has]
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
    n_bays, length = len(street.scanners), street.length / len(street.scanners)
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
    scanner, points = street.scanners[0, :2], street.true_points[behind]
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


def test_each_kind_of_outlier_has_its_equal_share():
    street = make_street(10_000, outlier_share=0.1003, random_state=6)
    assert_array_equal(np.bincount(street.outlier_kind), [8997, 251, 251, 251, 250])


def test_only_the_asked_kinds_are_made():
    street = make_street(2000, outlier_kinds=["ghost"], outlier_share=0.2, random_state=7)
    names = np.array(street.outlier_kind_names)[np.unique(street.outlier_kind)]
    assert_array_equal(names, ["regular", "ghost"])


def test_no_outlier_lies_within_four_noise_scales_of_a_surface_or_in_foliage(street):
    outlier = street.target == -1
    distance = scene_of(street, tree=True).distance(street.data[outlier])
    assert (distance > 4 * street.noise_scale[outlier]).all()


def of_kind(street, kind):
    return street.data[street.outlier_kind == street.outlier_kind_names.index(kind)]


def test_gaussian_outliers_are_as_far_from_the_surfaces_as_their_law_says():
    street = make_street(
        30_000, noise=0, outlier_share=0.5, outlier_kinds=["gaussian"], random_state=8
    )
    points = of_kind(street, "gaussian")
    # Before the open road nothing else is near: |z| is half-normal with a scale of 0.2 m.
    above = points[(points[:, 1] > 0.8) & (points[:, 1] < 2.2)]
    above = above[np.abs(above[:, 0] - 2.5) < 1.5]
    height = scene_of(street).distance(above)
    assert len(above) > 1000
    assert np.median(height) == pytest.approx(0.2 * 0.6745, rel=0.08)
    assert height.max() < 1.1


def test_uniform_outliers_fill_the_bounding_box_evenly():
    street = make_street(
        10_000, noise=0, outlier_share=0.3, outlier_kinds=["uniform"], random_state=9
    )
    low, high = scene_of(street).bounds
    for column, a, b in zip(of_kind(street, "uniform").T, low, high, strict=True):
        assert kstest(column, "uniform", args=(a, b - a)).pvalue > 1e-3


def test_mixed_pixels_lie_behind_an_outline_and_before_a_background():
    street = make_street(10_000, outlier_kinds=["mixed_pixel"], random_state=10)
    scene = scene_of(street)
    scanner, points = street.scanners[0], of_kind(street, "mixed_pixel")
    rng = np.random.default_rng(13)
    outlines = np.concatenate(
        [
            part.sample_outline(20_000, rng, scanner)
            for part in scene.parts
            if part.outline_length > 0
        ]
    )

    def direction(x):
        return (x - scanner) / np.linalg.norm(x - scanner, axis=1, keepdims=True)

    neighbors = cKDTree(direction(outlines)).query_ball_point(direction(points), 0.02)
    ranges = np.linalg.norm(outlines - scanner, axis=1)
    for point, found in zip(points, neighbors, strict=True):
        assert ranges[found].min() < np.linalg.norm(point - scanner)
    beyond = scanner + 4 * (points - scanner)
    meeting = scene.first_hit(beyond)
    assert (meeting > 0.25).all()
    assert np.isfinite(meeting).all()


def test_ghosts_are_dense_balls_off_the_surfaces():
    street = make_street(20_000, outlier_kinds=["ghost"], random_state=11)
    points = of_kind(street, "ghost")
    company = cKDTree(points).query_ball_point(points, 0.2, return_length=True)
    assert company.min() >= 10
    assert scene_of(street).distance(points).min() > 0.15 - 1e-9


@pytest.mark.parametrize("n", [10, 35, 52, 53, 70, 87, 88, 1234, 50_000])
def test_clusters_hold_10_to_60_points_and_all_together(n):
    for seed in range(5):
        sizes = _cluster_sizes(n, np.random.default_rng(seed))
        assert sizes.sum() == n
        assert sizes.min() >= 10
        assert sizes.max() <= 60


def test_the_bays_of_a_long_street_are_shared_evenly():
    street = make_street(60_000, spacing=0.05, outlier_share=0, random_state=12)
    counts = np.bincount(street.bay)
    assert len(counts) == len(street.scanners) > 3
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

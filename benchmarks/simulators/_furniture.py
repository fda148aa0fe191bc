"""Simulated counterparts of the two roadside scenes in the paper's Section 5.2.3.

Sharp edges are the lines where surfaces meet at an angle, and the free ends of things, as in
`make_street`. There is none where only the scene ends. Arrays are those of `make_street`.
"""

import numpy as np

from sklearn_mcmd.datasets._scan import Scene, scan
from sklearn_mcmd.datasets._street import KERB_Y, PATH_Z, UP, facing, feet, pole, road_and_kerb
from sklearn_mcmd.datasets._surfaces import Circle, Foliage, Patch

from ._panels import Disc, Polygon


def make_traffic_furniture(n_samples=127_898, *, noise=0.005, outlier_share=0.0, random_state=None):
    """10 m of a road with traffic furniture: the counterpart of the paper's Fig. 14.

    It has 21 surfaces, like the paper's data set. Ten are flat (road, kerb, footpath, five sign
    plates, two lids of litter bins) and eleven are round (six sign posts, two light poles, two
    litter bins, an advertising column). The default number of points is the paper's.
    """
    return scan(_traffic_furniture(), n_samples, noise, outlier_share, random_state)


def make_bus_stop(n_samples=33_719, *, noise=0.005, outlier_share=0.0, random_state=None):
    """9 m of a road with a bus stop: the counterpart of the paper's Fig. 15.

    The scanner sees 31 surfaces, like the paper's data set: road, kerb, footpath; a shelter (three
    panels, roof and its fascia, four posts) with a bench (front, seat, back); two umbrellas on
    poles, three panels each; a light pole; a bus sign and a timetable on a post; a litter bin with
    its lid; a tree of trunk and foliage. The back panels of the umbrellas have a name, but no
    points. The default number of points is the paper's.
    """
    return scan(_bus_stop(), n_samples, noise, outlier_share, random_state)


def _traffic_furniture():
    length = 10.0
    turned = [np.radians(angle) for angle in (25, 15, 0, -15, -25)]
    things = [
        *_rectangular_sign("sign_1", (1.5, 3.5), turned[0], 0.6, 0.6, 1.8, 1),
        *_rectangular_sign("sign_2", (3.2, 3.7), turned[1], 0.4, 0.8, 1.7, 1),
        *_rectangular_sign("sign_3", (6.2, 4.2), turned[2], 1.6, 0.9, 1.6, 2),
        *_round_sign("sign_4", (8.3, 3.5), turned[3], 0.3, 2.1),
        *_triangular_sign("sign_5", (9.4, 3.4), turned[4], 0.9, 1.75),
        pole("light_pole_1", (2.4, 5.0), 0.09, 4.5),
        pole("light_pole_2", (7.7, 5.0), 0.09, 4.5),
        *_bin("bin_1", (4.1, 3.4), 0.2, 0.9),
        *_bin("bin_2", (4.9, 3.4), 0.2, 0.9),
        pole("column", (4.5, 4.8), 0.35, 2.9),
    ]
    parts = [*_ground(length, 5.5, circles=feet(things)), *things]
    return Scene(parts, scanner=(length / 2, 1.0, 2.2))


def _bus_stop():
    length = 9.0
    x0, x1, y0, y1 = 3.0, 6.0, 4.2, 5.2  # the shelter's posts
    low, top, roof_z = PATH_Z + 0.2, 2.1, 2.5
    posts = [
        pole(f"shelter_post_{i}", foot, 0.05, roof_z)
        for i, foot in enumerate([(x0, y0), (x1, y0), (x0, y1), (x1, y1)], 1)
    ]
    # Panels end before the posts that hold them.
    gap, side, back = 0.12, y1 - y0 - 0.24, x1 - x0 - 0.24
    roof_corner, roof_size = np.array([x0 - 0.2, y0 - 0.2, roof_z]), (x1 - x0 + 0.4, y1 - y0 + 0.4)
    shelter = [
        Patch("shelter_back", (x0 + gap, y1, low), (back, 0, 0), (0, 0, top - low)),
        Patch("shelter_left", (x0, y0 + gap, low), (0, side, 0), (0, 0, top - low)),
        Patch("shelter_right", (x1, y0 + gap, low), (0, 0, top - low), (0, side, 0)),
        Patch(
            "shelter_roof",
            roof_corner,
            (0, roof_size[1], 0),
            (roof_size[0], 0, 0),
            circles=[Circle(post.base + post.length * UP, UP, post.radius) for post in posts],
        ),
        Patch("shelter_fascia", roof_corner, (roof_size[0], 0, 0), (0, 0, 0.25)),
        *posts,
    ]
    bench_x, bench_w, bench_y, bench_d, bench_z = 3.5, 2.0, 4.55, 0.4, 0.55
    along, across = np.array([bench_w, 0, 0]), np.array([0, bench_d, 0])
    foot, seat = (np.array([bench_x, bench_y, z]) for z in (PATH_Z, bench_z))
    bench = [
        Patch("bench_front", foot, along, (0, 0, bench_z - PATH_Z)),
        Patch("bench_seat", seat, along, across),
        Patch("bench_back", seat + across, along, (0, 0, 0.4)),
    ]
    things = [
        *_umbrella("umbrella_1", (1.3, 4.6)),
        *_umbrella("umbrella_2", (7.6, 4.7)),
        pole("light_pole", (6.0, 3.4), 0.09, 4.5),
        *_rectangular_sign("bus_sign", (3.2, 3.3), np.radians(10), 0.5, 0.5, 2.0, 1),
        _timetable((3.2, 3.3), np.radians(10)),
        *_bin("bin", (6.6, 3.6), 0.2, 0.9),
        pole("trunk", (8.5, 3.7), 0.14, 2.3),
        Foliage("foliage", (8.5, 3.7, 2.7), 0.6),
    ]
    lines = [(foot, foot + along), *[(foot + x, foot + x + across) for x in (0, along)]]
    ground = _ground(length, 5.8, circles=feet([*posts, *things]), lines=lines)
    parts = [*ground, *shelter, *bench, *things]
    return Scene(parts, scanner=(length / 2, 1.0, 2.2))


def _ground(length, path_y, *, circles, lines=()):
    """Half of a cambered road, its kerb and a footpath."""
    footpath = Patch(
        "footpath",
        (0, KERB_Y, PATH_Z),
        (length, 0, 0),
        (0, path_y - KERB_Y, 0),
        smooth=("u0", "u1", "v1"),
        circles=circles,
        lines=lines,
    )
    return [*road_and_kerb(length), footpath]


def _bin(name, foot, radius, top):
    return [
        pole(name, foot, radius, top),
        Disc(f"{name}_lid", (*foot, top), UP, radius),
    ]


def _rectangular_sign(name, foot, turn, width, height, bottom, n_posts, before=0.07):
    """A plate, 7 cm in front of the axes of one or two posts."""
    along, toward = facing(turn)
    middle = np.array([*foot, bottom]) + before * toward
    plate = Patch(name, middle - 0.5 * width * along, width * along, (0, 0, height))
    offsets = [0.0] if n_posts == 1 else [-0.3 * width, 0.3 * width]
    posts = [
        pole(
            f"{name}_post" if n_posts == 1 else f"{name}_post_{i}",
            np.add(foot, offset * along[:2]),
            0.03,
            bottom + height + 0.1,
        )
        for i, offset in enumerate(offsets, 1)
    ]
    return [plate, *posts]


def _round_sign(name, foot, turn, radius, height):
    _, toward = facing(turn)
    plate = Disc(name, np.array([*foot, height]) + 0.07 * toward, toward, radius)
    return [plate, pole(f"{name}_post", foot, 0.03, height + radius + 0.1)]


def _triangular_sign(name, foot, turn, side, bottom):
    along, toward = facing(turn)
    height = side * np.sqrt(3) / 2
    low = np.array([*foot, bottom]) + 0.07 * toward
    corners = [low - 0.5 * side * along, low + 0.5 * side * along, low + height * UP]
    return [Polygon(name, corners), pole(f"{name}_post", foot, 0.03, bottom + height + 0.1)]


def _timetable(foot, turn):
    return _rectangular_sign("timetable", foot, turn, 0.4, 0.6, 1.1, 1)[0]


def _umbrella(name, foot, rim=0.9, rim_z=1.85, apex_z=2.35):
    """A pyramid of six panels on a pole, with a flat side towards the road."""
    angles = np.radians(np.arange(0, 361, 60) - 120)
    ring = np.column_stack([foot[0] + rim * np.cos(angles), foot[1] + rim * np.sin(angles)])
    ring = np.column_stack([ring, np.full(len(ring), rim_z)])
    apex = np.array([*foot, apex_z])
    panels = [
        Polygon(f"{name}_panel_{i}", [ring[i - 1], ring[i], apex]) for i in range(1, len(ring))
    ]
    return [pole(f"{name}_pole", foot, 0.03, apex_z), *panels]

"""The unit of coordinates is told only where the file tells it for all axes."""

from types import SimpleNamespace

import numpy as np
import pytest

from sklearn_mcmd.io import PointCloud, read_points
from sklearn_mcmd.io._units import degrees_warning, length_unit

GEOGRAPHIC = 'GEOGCS["NAD83",DATUM["x",SPHEROID["GRS 80",6378137,298.25]],UNIT["degree",0.0174533]]'
FOOT = '["US survey foot",0.304800609601219]'


def cloud(wkt="", keys=()):
    records = [SimpleNamespace(string=wkt)]
    keys = [SimpleNamespace(id=key, value_offset=code) for key, code in keys]
    records.append(SimpleNamespace(geo_keys=keys))
    return PointCloud(np.eye(3), {}, {"las_header": SimpleNamespace(vlrs=records, evlrs=None)})


@pytest.mark.parametrize(
    ("wkt", "keys", "unit"),
    [
        (f'PROJCS["x",{GEOGRAPHIC},UNIT["foot",0.3048,AUTHORITY["EPSG","9002"]]]', (), "ft"),
        (f'COMPD_CS["x",PROJCS["x",UNIT{FOOT}],VERT_CS["y",UNIT{FOOT}]]', (), "US ft"),
        (f'COMPD_CS["x",PROJCS["x",UNIT["metre",1]],VERT_CS["y",UNIT{FOOT}]]', (), None),
        (f'COMPD_CS["x",{GEOGRAPHIC},VERT_CS["y",UNIT["metre",1]]]', (), None),
        (
            'PROJCRS["x",BASEGEOGCRS["y",ELLIPSOID["GRS 1980",6378137,298.25,'
            'LENGTHUNIT["metre",1]]],PARAMETER["False easting",5,LENGTHUNIT["metre",1]],'
            f'CS[Cartesian,2],AXIS["(E)",east,LENGTHUNIT{FOOT}]]',
            (),
            "US ft",
        ),
        (GEOGRAPHIC, (), None),
        ("", ((3076, 9001),), "m"),
        ("", ((3076, 9003), (4099, 9003)), "US ft"),
        ("", ((3076, 9001), (4099, 9003)), None),
        ("", ((2048, 4326), (4099, 9001)), None),
        ("", ((3076, 9999),), None),
    ],
)
def test_the_unit_of_a_projected_system_is_told_where_all_axes_have_it(wkt, keys, unit):
    assert length_unit(cloud(wkt, keys)) == unit


def test_e57_is_in_meters_and_other_formats_have_no_unit(shared_data):
    assert length_unit(PointCloud(np.eye(3), {}, {"sensor_origins": np.zeros((1, 3))})) == "m"
    assert length_unit(PointCloud(np.eye(3))) is None
    assert length_unit(read_points(shared_data / "autzen_trim" / "autzen_trim.laz")) == "ft"


RNG = np.random.default_rng(0)
ROOM = RNG.random((500, 3)) * [4, 4, 2.5]
TERRAIN = RNG.random((500, 3)) * [10_000, 10_000, 60]
DEGREES = ROOM / [111_000, 67_000, 1] + [13.4, 52.5, 40]
WKT2 = 'GEOGCRS["WGS 84",DATUM["x",ELLIPSOID["y",6378137,298.25]],CS[ellipsoidal,2]]'


@pytest.mark.parametrize("xyz", [DEGREES, DEGREES[:, [1, 0, 2]], TERRAIN / [111_000, 67_000, 1]])
def test_degrees_are_known_by_heights_that_reach_much_farther(xyz):
    words = degrees_warning("a.las", xyz)
    assert "a.las: x and y seem to be degrees" in words
    assert "heights reach so much farther" in words


SYSTEMS = [
    (GEOGRAPHIC, (), True),
    (WKT2, (), True),
    (f'COMPD_CS["x",{GEOGRAPHIC},VERT_CS["y",UNIT["m",1]]]', (), True),
    ("", ((2048, 4326),), True),
    ("", ((1024, 2), (2048, 4326)), True),
    (f'PROJCS["x",{GEOGRAPHIC},UNIT["metre",1]]', (), False),
    ('GEOCCS["x",DATUM["y"],UNIT["metre",1]]', (), False),
    ('GEODCRS["x",DATUM["y"],CS[Cartesian,3],LENGTHUNIT["metre",1]]', (), False),
    ('LOCAL_CS["site",UNIT["metre",1]]', (), False),
    ("", ((2048, 4326), (3072, 25833)), False),
    ("", ((1024, 1), (2048, 4258)), False),
]


@pytest.mark.parametrize(("wkt", "keys", "geographic"), SYSTEMS)
def test_the_coordinate_system_of_a_file_is_believed(wkt, keys, geographic):
    header = cloud(wkt, keys).metadata["las_header"]
    for xyz in (DEGREES, DEGREES * [1, 1, 0]):
        words = degrees_warning("a.las", xyz, header)
        assert "coordinate system is geographic" in words if geographic else words is None
    assert degrees_warning("a.las", TERRAIN, header) is None  # no degrees, whatever it says


@pytest.mark.parametrize("name", ["lon", "LON", "Longitude", "lon_deg", "gps lat"])
def test_degrees_are_known_by_the_columns_that_are_chosen(name):
    flat = DEGREES * [1, 1, 0]
    assert f"they are {name})" in degrees_warning("a.csv", flat, columns={"x": name, "y": 2})
    assert degrees_warning("a.csv", TERRAIN, columns={"x": name, "y": 2}) is None
    assert degrees_warning("a.csv", flat, columns={"x": "along", "y": "plate"}) is None


SMALL = [ROOM * [0.01, 0.01, 1], TERRAIN, TERRAIN / 1000, ROOM[:1]]
SMALL += [np.vstack([ROOM / 1000, [0, 0, 90]]), ROOM * [0, 0, 1], ROOM * [1e-4, 1, 1]]  # a wall


@pytest.mark.parametrize("xyz", SMALL)
def test_small_things_and_poles_are_not_taken_for_degrees(xyz):
    assert degrees_warning("a.las", xyz) is None


def test_heights_of_200_times_the_extent_of_x_and_y_are_the_limit():
    box = np.stack(np.meshgrid(*[np.linspace(0, 1, 11)] * 3), axis=-1).reshape(-1, 3)
    for times, warns in ((190, False), (210, True)):
        xyz = box * [0.001, 0.001, 0.001 * times] + [13.4, 52.5, 40]
        assert (degrees_warning("a.las", xyz) is not None) == warns

"""The unit of coordinates is told only where the file tells it for all axes."""

from types import SimpleNamespace

import numpy as np
import pytest

from sklearn_mcmd.io import PointCloud
from sklearn_mcmd.io._units import length_unit

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
        (f'PROJCS["x",{GEOGRAPHIC},UNIT["metre",1]]', (), "m"),
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
        ("", (), None),
    ],
)
def test_the_unit_of_a_projected_system_is_told_where_all_axes_have_it(wkt, keys, unit):
    assert length_unit(cloud(wkt, keys)) == unit


def test_e57_is_in_meters_and_other_formats_do_not_tell():
    assert length_unit(PointCloud(np.eye(3), {}, {"sensor_origins": np.zeros((1, 3))})) == "m"
    assert length_unit(PointCloud(np.eye(3))) is None


def test_a_real_file_in_feet_says_so(shared_data):
    from sklearn_mcmd.io import read_points

    assert length_unit(read_points(shared_data / "autzen_trim" / "autzen_trim.laz")) == "ft"

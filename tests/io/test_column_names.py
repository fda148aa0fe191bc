"""Coordinates are found by the names that people give to columns."""

import pytest

from sklearn_mcmd.io import PointFileError, read_points


def places(tmp_path, names, columns=None):
    """Which columns of a table of text are x, y and z."""
    row = ";".join(map(str, range(len(names))))
    (tmp_path / "a.csv").write_text(f"{';'.join(names)}\n{row}\n", encoding="utf-8")
    return read_points(tmp_path / "a.csv", columns=columns).xyz[0].tolist()


NAMES = (
    "x y z, id Y X Z, point northing easting elevation, E N H, East North Altitude, "
    "X[m] Y[m] Z[m] height, x_m y_m z_m normal_x nx ny nz, "
    "Points:0 Points:1 Points:2 Normals:0 Normals:1 Normals:2, "
    "Points_0 Points_1 Points_2, POINT_X POINT_Y POINT_Z, utm_x utm_y elev_ft, "
    "n easting northing height h u v e, x y z easting northing height, "
    "Rechtswert Hochwert height, height_above_ground x y elevation, "
    "Rechtswert Hochwert Höhe, RECHTSWERT HOCHWERT HÖHE, "
    "Rechtswert[m] Hochwert[m] Hoehe[m], x_koordinate y_koordinate Ho\u0308he, "
    "Ost Nord Höhe, est nord hauteur, Coordonnée_X Coordonne\u0301e_Y élévation, "
    "este norte cota, coordenada_x coordenada_y elevación, Est Nord Quota, "
    "est nord altezza label"
)


@pytest.mark.parametrize("names", NAMES.split(", "))
def test_names_that_people_use_are_known(tmp_path, names):
    first = {"point": [2, 1, 3], "id": [2, 1, 3], "n": [1, 2, 3], "height_above_ground": [1, 2, 3]}
    names = names.split()
    assert places(tmp_path, names) == first.get(names[0], [0, 1, 2])


@pytest.mark.parametrize(
    ("names", "columns", "message"),
    [
        ("point a b c", None, "no x, y, z among the columns point, a, b, c: say which they are"),
        ("longitude latitude height", None, "no x, y among the columns longitude, latitude, heig"),
        ("e n h est", None, "x may be 'e' or 'est' among"),  # which may be an estimate
        ("x y height elevation", None, "z may be 'height' or 'elevation' among the columns x, y"),
        ("a b c", {"x": "a", "y": "B", "z": "c"}, "no column 'B' among a, b, c"),
        ("a b c", {"x": 1, "y": 2, "z": 4}, "no column '4' among a, b, c"),
        ("a b c", {"x": 1, "y": "a", "z": 3}, "need three columns, got columns="),
    ],
)
def test_names_that_are_not_known_or_not_clear_are_refused(tmp_path, names, columns, message):
    with pytest.raises(PointFileError, match=message):
        places(tmp_path, names.split(), columns)


@pytest.mark.parametrize(
    ("which", "name"),
    [("Höhe", "Ho\u0308he"), ("Ho\u0308he", "Höhe"), ("höhe", "Höhe"), ("höhe", "ho\u0308he")],
)
def test_letters_are_the_same_in_any_case_whether_their_accents_are_apart_or_not(
    tmp_path, which, name
):
    assert places(tmp_path, ["c", "a", "b", name], {"x": "a", "y": "b", "z": which}) == [1, 2, 3]

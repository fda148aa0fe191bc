"""Text however it is laid out."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import PointCloud, PointFileError, _text, read_points, write_points

LAYOUTS = {
    "spaces": "1  2 3.5 4\n 5 6 7  8\n",
    "tabs with header": "X\tY\tZ\tlabel\n1\t2\t3.5\t4\n5\t6\t7\t8\n",
    "commas with header": "x,y,z,label\n1,2,3.5,4\n5,6,7,8",
    "semicolons": "1;2;3.5;4\r\n5;6;7;8\r\n",
    "byte order mark": "\ufeffx,y,z,label\n1,2,3.5,4\n5,6,7,8\n",
    "comment header": "//X Y Z label\n1 2 3.5 4\n5 6 7 8\n",
    "other order": "label;z;y;x\n4;3.5;2;1\n8;7;6;5\n",
    "comments and blanks": "# a survey\n\n1 2 3.5 4\n\n5 6 7 8 # last\n",
    "quotes around everything": '"x","y","z","label"\n"1","2","3.5","4"\n"5","6","7","8"\n',
    "quotes and tabs": '"x"\t"y"\t"z"\t"label"\n"1"\t"2"\t"3.5"\t"4"\n"5"\t"6"\t"7"\t"8"\n',
    "quotes in the second row": 'x,y,z,label\n1,2,3.5,4\n"5","6","7","8"\n',
    "a title and units": "Survey in May\nx,y,z,label\n[m],[m],[m],\n1,2,3.5,4\n5,6,7,8\n",
    "a count below the header": "//X Y Z label\n2\n1 2 3.5 4\n5 6 7 8\n",
    "a trailing delimiter of the header": "x\ty\tz\tlabel\t\n1\t2\t3.5\t4\n5\t6\t7\t8\n",
    "columns and rows of a spreadsheet": "x,y,z,label,,\n1,2,3.5,4,,\n5,6,7,8,,\n,,,,,\n",
    "names of several words": "Point ID\tX\tY\tZ\tlabel\n\t1\t2\t3.5\t4\n\t5\t6\t7\t8\n",
    "the header of numpy.savetxt": "# easting northing height label\n1,2,3.5,4\n5,6,7,8\n",
    "a comment with a name for each column": "# x y z in UTM 33\n# label z y x\n4 3.5 2 1\n8 7 6 5",
    "the first comment that holds coordinates": "# lon,lat,time,id\n# z,y,x,label\n# x,y,z,other\n"
    "3.5,2,1,4\n7,6,5,8",
}


def read(tmp_path, text, encoding="utf-8", **options):
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    return read_points(tmp_path / "a.csv", **options)


def same_by_parts(tmp_path, monkeypatch, text, encoding="utf-8", **options):
    """The table of a text, coordinates first, which is the same whatever is read at once."""
    tables = []
    for at_once in (1, 2, 100_000):
        monkeypatch.setattr(_text, "ROWS_A_TIME", at_once)
        cloud = read(tmp_path, text, encoding, **options)
        tables.append(np.column_stack([cloud.xyz, *cloud.attributes.values()]))
        assert_array_equal(tables[-1], tables[0])
    return cloud, tables[0]


@pytest.mark.parametrize("kind", LAYOUTS)
def test_text_is_read_however_it_is_laid_out(tmp_path, monkeypatch, kind):
    cloud, _ = same_by_parts(tmp_path, monkeypatch, LAYOUTS[kind])
    assert_array_equal(cloud.xyz, [[1, 2, 3.5], [5, 6, 7]])
    labels = cloud.attributes["label" if "label" in LAYOUTS[kind] else "column_4"]
    assert_array_equal(labels, [4, 8])
    assert labels.dtype == np.int64


GERMAN = "Rechtswert;Hochwert;Höhe;Güte\n"
TABLES = [
    # Numbers that are missing, and those of R and other programs.
    ("nan,2,3\n4,5,6\n", "4 5 6"),
    ("x,y,z,a,b\n1,2,3,,7\n4,5,6,0.5,8", "1 2 3 nan 7, 4 5 6 0.5 8"),
    *[
        (f"1,2,3,0.5\n4,5,6,{cell}", "1 2 3 0.5, 4 5 6 nan")
        for cell in ("", "null", "N/A", " None", "-nan(ind)")
    ],
    ('"","x","y","z"\n"1",0.5,2,3\n"2",4,5,6\n', "0.5 2 3 1, 4 5 6 2"),
    (
        "x,y,z,a\n0,1,2,0\n1,2,3,1\n2,3,4,\n3,4,5,NA\n\n# e",
        "0 1 2 0, 1 2 3 1, 2 3 4 nan, 3 4 5 nan",
    ),
    *[(f"1,2,3,5\n4,5,6,{cell}\n", f"1 2 3 5, 4 5 6 {cell}") for cell in ("1e300", "inf", 10**20)],
    # Decimal commas between semicolons.
    (GERMAN + "1,5;2,5;3,5;1\n0,125;1,25e3;,5;0,25", "1.5 2.5 3.5 1, 0.125 1250 0.5 0.25"),
    ("1;2;3;4\n5;6;7;8\n312,403;1,1;2,2;3,3", "1 2 3 4, 5 6 7 8, 312.403 1.1 2.2 3.3"),
    ('345,678;"567,890";12', "345.678 567.89 12"),
    ("1\t\t2\t\t3\n4\t\t5\t\t6\n", "1 2 3, 4 5 6"),
    # Commas between columns.
    ("1, 2, 3\n4, 5, 6", "1 2 3, 4 5 6"),
    ("1 ,2 ,3", "1 2 3"),
    ("x,y,z,a,b,c\n7,016,8,32,9,5", "7 16 8 32 9 5"),
    # Counts begin scans, which get a number.
    ("0\n1\n1 2 3\n\n0\n2\n1 2 3\n4 5 6 # last\n# end\n", "1 2 3 1, 1 2 3 3, 4 5 6 3"),
]


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize(("text", "table"), TABLES)
def test_numbers_of_many_programs_are_read(tmp_path, monkeypatch, text, table, separator):
    back = same_by_parts(tmp_path, monkeypatch, text.replace(";", separator))[1]
    assert_array_equal(back, [list(map(float, row.split())) for row in table.split(",")])


NUMBERS = {"-.5": -0.5, "1.": 1, "0.25e-02": 0.0025, "1E5": 1e5}
WORDS = ["1.0D+00", "1_000.5", "wall", "1,5", "1,234,567.5", "1'234.5", "1.#IND"]


@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("cell", [*NUMBERS, *WORDS])
def test_numbers_are_read_as_they_are_meant_and_others_are_none(tmp_path, cell, decimal):
    swap = str.maketrans(",.", ".," if decimal == "," else ",.")
    text = f"0.5;2;3\n{cell};2;3\n".translate(swap)
    if cell in NUMBERS:
        assert_array_equal(read(tmp_path, text).xyz[:, 0], [0.5, NUMBERS[cell]])
    else:
        with pytest.raises(PointFileError, match=r"line 2: .* is not a number"):
            read(tmp_path, text)


# ---- columns -----------------------------------------------------------------------------


def test_columns_of_words_are_left_out_with_a_warning_that_names_them(tmp_path):
    text = "day,name,x,y,z,id,note\n2026-05-01,A,1,2,3,10,\n2026-05-02,B,4,5,6,10a,#4\n"
    named = r"day \(line 2: '2026-05-01'\), name \(line 2: 'A'\), id \(line 3: '10a'\)"
    with pytest.warns(UserWarning, match=rf"left out: {named}, note \(line 3: '#4'\)"):
        cloud = read(tmp_path, text)
    assert_array_equal(cloud.xyz, [[1, 2, 3], [4, 5, 6]])
    assert not cloud.attributes
    with pytest.warns(UserWarning, match=r"words are left out: column_4 \(line 1: 'w.1'\)"):
        cloud = read(tmp_path, "1;2;3;w.1\n4.5;5;6;road\n")  # whose point is no decimal one
    assert_array_equal(cloud.xyz, [[1, 2, 3], [4.5, 5, 6]])


@pytest.mark.parametrize("encoding", ["latin-1", "utf-8"])
def test_text_may_be_in_latin_1(tmp_path, encoding):
    text = "Rechtswert;Hochwert;Höhe;Länge;Straße\n1;2;3;4;Ä\n5;6;7;8;Ü\n"
    with pytest.warns(UserWarning, match=r"Straße \(line 2: 'Ä'\)"):
        cloud = read(tmp_path, text, encoding)
    assert_array_equal(cloud.xyz, [[1, 2, 3], [5, 6, 7]])
    assert list(cloud.attributes) == ["Länge"]


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be", "utf-8"])
def test_a_byte_order_mark_tells_the_encoding(tmp_path, encoding):
    cloud = read(tmp_path, "\ufeffRechtswert;Hochwert;Höhe;Zeit\n1,5;2;3;4\n", encoding)
    assert_array_equal(cloud.xyz, [[1.5, 2, 3]])
    assert cloud.attributes["Zeit"].tolist() == [4]


def test_columns_say_where_the_coordinates_are(tmp_path):
    rows = "\n2026-05-01,noon,A,3,2,1\n2026-05-02,noon,B,6,5,4"
    names = "day,hour,name,hoch,nord,ost"
    for head, columns in [
        (f"May\n{names}", {"x": "ost", "y": "nord", "z": "hoch"}),
        ("", {"x": 6, "y": 5, "z": 4}),
    ]:
        with pytest.warns(UserWarning, match="left out"):
            cloud = read(tmp_path, head + rows, columns=columns)
        assert_array_equal(cloud.xyz, [[1, 2, 3], [4, 5, 6]])
    cloud = read(tmp_path, "x,y,z,height\n1,2,3,4\n", columns={"z": "height"})
    assert_array_equal(cloud.xyz, [[1, 2, 4]])
    assert_array_equal(cloud.attributes["z_value"], [3])
    with pytest.raises(PointFileError, match="must tell of x, y or z"):
        read(tmp_path, "a,b,c\n1,2,3\n", columns={"a": "x"})


@pytest.mark.parametrize("first", [-(2**63), 2**64 - 1, 2**53])
def test_integers_that_must_be_rounded_are_named(tmp_path, first):
    with pytest.warns(UserWarning, match="integers of t are rounded to 53 bits"):
        cloud = read(tmp_path, f"x,y,z,t\n1,2,3,{first}\n1,2,3,4\n")
    assert_array_equal(cloud.attributes["t"], [float(first), 4])


@pytest.mark.parametrize("extension", [".csv", ".txt", ".xyz"])
@pytest.mark.parametrize("name", ["a;b", "a,b", "a b", 'a"b', 'a", b', ";", "#a"])
def test_names_of_attributes_come_back(tmp_path, name, extension):
    path = tmp_path / f"a{extension}"
    write_points(path, PointCloud(np.eye(3), {name: np.arange(3), "q": np.arange(3) / 3}))
    back = read_points(path)
    assert list(back.attributes) == [name, "q"]
    assert_array_equal(back.attributes[name], np.arange(3))


# ---- comments above the rows -------------------------------------------------------------


def test_columns_are_found_by_the_names_of_a_comment(tmp_path):
    for text in ("# id a b c\n9 1 2 3\n", "#id,a,b,c\n9,1,2,3,\n", "#id;a;b;c\n9;1;2;3\n"):
        cloud = read(tmp_path, text, columns={"x": "a", "y": "b", "z": "c"})
        assert_array_equal(cloud.xyz, [[1, 2, 3]])
        assert list(cloud.attributes) == ["id"]


COMMENTS = ["exported by CloudCompare", "12 points surveyed", "height in m", "punti e quota"]
COMMENTS += ["Berlin, Mitte, Nord", "scanned,cleaned", "x y z are UTM", "2026-05-01,scanner,A"]
COMMENTS += ["time, position and intensity of the scanner", "4,5,6", "4;5;6"]  # rows are left out
# Of as many words as there are columns, or nearly.
COMMENTS += ["CloudCompare v2.12 ASCII export", "Scan of hall 3", "Project: Castle hall scan"]
COMMENTS += ["hall hall north south", "a b c", "a b c d e", "- m m m", "a b c d\n# made by tool v2"]


@pytest.mark.parametrize("comment", COMMENTS)
def test_other_comments_leave_the_first_three_columns_to_be_coordinates(tmp_path, comment):
    for separator, cells in [(" ", "1234"), (" ", "123"), (",", "123"), (";", "123")]:
        row = separator.join(cells)
        cloud = read(tmp_path, f"# {comment}\n//{comment}\n{row}\n{row}")
        assert_array_equal(cloud.xyz, [[1, 2, 3], [1, 2, 3]])


UNKNOWN = ["time a b height", "TIME lon lat"]
UNKNOWN += ["LONGITUDE_CENTROID LATITUDE_CENTROID ELEVATION_CENTROID", "lat_deg;lon_deg;h_m"]


@pytest.mark.parametrize("mark", ["", "# ", "// made by tool v2\n//"])
@pytest.mark.parametrize("names", UNKNOWN)
def test_names_of_a_comment_are_refused_as_those_of_a_header(tmp_path, mark, names):
    separator = next((one for one in ",;" if one in names), " ")
    row = separator.join("1234"[: len(names.split(separator))])
    listed = ", ".join(names.split(separator))
    with pytest.raises(PointFileError, match=f"no x.* among the columns {listed}: say which they"):
        read(tmp_path, f"{mark}{names}\n{row}\n{row}")
    columns = {"x": 1, "y": 2, "z": 3}
    assert_array_equal(read(tmp_path, f"{mark}{names}\n{row}", columns=columns).xyz, [[1, 2, 3]])

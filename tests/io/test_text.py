"""Text however it is laid out."""

import csv
import warnings

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import PointCloud, PointFileError, _text, read_points, write_points

TEXTS = {
    "spaces": "1  2 3.5 4\n 5 6 7  8\n",
    "tabs with header": "X\tY\tZ\tlabel\n1\t2\t3.5\t4\n5\t6\t7\t8\n",
    "commas with header": "x,y,z,label\n1,2,3.5,4\n5,6,7,8",
    "semicolons": "1;2;3.5;4\r\n5;6;7;8\r\n",
    "byte order mark": "\ufeffx,y,z,label\n1,2,3.5,4\n5,6,7,8\n",
    "comment header": "//X Y Z label\n1 2 3.5 4\n5 6 7 8\n",
    "other order": "label;z;y;x\n4;3.5;2;1\n8;7;6;5\n",
    "comments and blanks": "# a survey\n\n1 2 3.5 4\n\n5 6 7 8 # last\n",
    "quotes around everything": '"x","y","z","label"\n"1","2","3.5","4"\n"5","6","7","8"\n',
    "quotes and semicolons": '"x";"y";"z";"label"\n"1";"2";"3.5";"4"\n"5";"6";"7";"8"\n',
    "quotes and tabs": '"x"\t"y"\t"z"\t"label"\n"1"\t"2"\t"3.5"\t"4"\n"5"\t"6"\t"7"\t"8"\n',
    "quotes without a header": '"1","2","3.5","4"\n"5","6","7","8"\n',
    "quotes in the second row": 'x,y,z,label\n1,2,3.5,4\n"5","6","7","8"\n',
    "a title and units": "Survey in May\nx,y,z,label\n[m],[m],[m],\n1,2,3.5,4\n5,6,7,8\n",
    "a count as in PTS": "2\n1 2 3.5 4\n5 6 7 8\n",
    "a count below the header": "//X Y Z label\n2\n1 2 3.5 4\n5 6 7 8\n",
    "trailing delimiters": "1,2,3.5,4,\n5,6,7,8,\n",
    "trailing delimiters of rows": "x,y,z,label\n1,2,3.5,4,\n5,6,7,8,\n",
    "a trailing delimiter of the header": "x\ty\tz\tlabel\t\n1\t2\t3.5\t4\n5\t6\t7\t8\n",
    "columns and rows of a spreadsheet": "x,y,z,label,,\n1,2,3.5,4,,\n5,6,7,8,,\n,,,,,\n",
    "names of several words": "Point ID\tX\tY\tZ\tlabel\n\t1\t2\t3.5\t4\n\t5\t6\t7\t8\n",
    "the header of numpy.savetxt": "# easting northing height label\n1,2,3.5,4\n5,6,7,8\n",
    "other names": '"easting", "northing", "height", "label"\n1, 2, 3.5, 4\n5, 6, 7, 8\n',
}


@pytest.mark.parametrize("kind", TEXTS)
@pytest.mark.parametrize("extension", [".xyz", ".txt", ".csv"])
def test_text_is_read_however_it_is_laid_out(tmp_path, extension, kind):
    (tmp_path / f"a{extension}").write_text(TEXTS[kind], encoding="utf-8")
    cloud = read_points(tmp_path / f"a{extension}")
    assert_array_equal(cloud.xyz, [[1, 2, 3.5], [5, 6, 7]])
    name = "label" if "label" in TEXTS[kind] else "column_4"
    assert_array_equal(cloud.attributes[name], [4, 8])
    assert cloud.attributes[name].dtype == np.int64


def read(tmp_path, text, encoding="utf-8", **options):
    (tmp_path / "a.csv").write_text(text, encoding=encoding)
    return read_points(tmp_path / "a.csv", **options)


def test_a_first_row_with_a_label_is_a_point(tmp_path):
    with pytest.warns(UserWarning, match=r"words are left out: column_4 \(line 1: 'wall'\)"):
        cloud = read(tmp_path, "1,2,3,wall\n4,5,6,road\n")
    assert_array_equal(cloud.xyz, [[1, 2, 3], [4, 5, 6]])


def test_a_first_row_without_a_position_is_dropped_and_counted(tmp_path):
    cloud = read(tmp_path, "nan,2,3\n4,5,6\n")
    assert_array_equal(cloud.xyz, [[4, 5, 6]])
    assert cloud.n_dropped == 1


@pytest.mark.parametrize("cell", ["", "NA", "null", "N/A", " None", "nan"])
@pytest.mark.parametrize("first", [True, False])
def test_missing_values_of_attributes_are_nan(tmp_path, cell, first):
    rows = [f"1,2,3,{cell},7", "4,5,6,0.5,8"]
    cloud = read(tmp_path, "\n".join(["x,y,z,a,b", *(rows if first else rows[::-1])]))
    order = slice(None) if first else slice(None, None, -1)
    assert_array_equal(cloud.attributes["a"][order], [np.nan, 0.5])
    assert cloud.attributes["b"].dtype == np.int64


def test_columns_of_words_are_left_out_with_a_warning_that_names_them(tmp_path):
    text = "day,name,x,y,z,id,note\n2026-05-01,A,1,2,3,10,\n2026-05-02,B,4,5,6,10a,#4\n"
    left_out = r"day \(line 2: '2026-05-01'\), name \(line 2: 'A'\), .* id \(line 3: '10a'\)"
    with pytest.warns(UserWarning, match="left out: " + left_out.replace(".* ", "")) as told:
        cloud = read(tmp_path, text)
    assert "note (line 3: '#4')" in str(told[0].message)
    assert_array_equal(cloud.xyz, [[1, 2, 3], [4, 5, 6]])
    assert not cloud.attributes


def test_text_may_be_in_latin_1(tmp_path):
    text = "Rechtswert;Hochwert;Höhe;Länge;Straße\n1;2;3;4;Ä\n5;6;7;8;Ü\n"
    for encoding in ("latin-1", "utf-8"):
        with pytest.warns(UserWarning, match=r"Straße \(line 2: 'Ä'\)"):
            cloud = read(tmp_path, text, encoding)
        assert_array_equal(cloud.xyz, [[1, 2, 3], [5, 6, 7]])
        assert list(cloud.attributes) == ["Länge"]


def test_surprises_late_in_a_file_are_met_in_its_other_parts(tmp_path, monkeypatch):
    monkeypatch.setattr(_text, "ROWS_A_TIME", 2)
    rows = [f"{i},{i + 1},{i + 2},{i}" for i in range(9)]
    rows[3], rows[6] = "3,4,5,", "6,7,8,NA"
    whole = read(tmp_path, "\n".join(["x,y,z,a", *rows, "", "", "# the end"]))
    assert_array_equal(whole.xyz, np.arange(9)[:, None] + np.arange(3))
    assert_array_equal(whole.attributes["a"], [0, 1, 2, np.nan, 4, 5, np.nan, 7, 8])
    with pytest.raises(PointFileError, match="line 10 has 3 columns, line 2 has 4"):
        read(tmp_path, "\n".join(["x,y,z,a", *rows[:8], "8,9,10"]))
    with pytest.raises(PointFileError, match="line 10: 'u' is not a number"):
        read(tmp_path, "\n".join(["x,y,z,a", *rows[:8], "8,u,10,9"]))


def test_columns_say_where_the_coordinates_are(tmp_path):
    rows = "\n2026-05-01,noon,A,3,2,1\n2026-05-02,noon,B,6,5,4"
    names = {"x": "ost", "y": "nord", "z": "hoch"}
    for text, columns in [
        (f"Survey in May\nday,hour,name,hoch,nord,ost{rows}", names),
        (f"day,hour,name,z,hoch,nord{rows}", {"x": 6, "y": 5, "z": 4}),
        (rows, {"x": 6, "y": 5, "z": 4}),
    ]:
        with pytest.warns(UserWarning, match="left out"):
            assert_array_equal(read(tmp_path, text, columns=columns).xyz, [[1, 2, 3], [4, 5, 6]])
    cloud = read(tmp_path, "x,y,z,height\n1,2,3,4\n", columns={"z": "height"})
    assert_array_equal(cloud.xyz, [[1, 2, 4]])
    assert_array_equal(cloud.attributes["z_value"], [3])


def test_columns_are_for_axes_of_formats_that_have_columns(tmp_path):
    with pytest.raises(PointFileError, match="must tell of x, y or z"):
        read(tmp_path, "a,b,c\n1,2,3\n", columns={"a": "x"})
    np.savez(tmp_path / "a.npz", np.eye(3))
    with pytest.raises(PointFileError, match="is for PLY, PCD, PTS, XYZN, XYZRGB, text and NPY"):
        read_points(tmp_path / "a.npz", columns={"x": 1})


def test_whole_numbers_among_fractions_do_not_make_a_column_integer(tmp_path):
    (tmp_path / "a.xyz").write_text("0 0 0 1\n0 0 0 1.5\n")
    assert_array_equal(read_points(tmp_path / "a.xyz").attributes["column_4"], [1, 1.5])


@pytest.mark.parametrize("sep", [",", ";", "\t", " "])
@pytest.mark.parametrize("quoting", [csv.QUOTE_ALL, csv.QUOTE_NONNUMERIC, csv.QUOTE_MINIMAL])
def test_tables_of_pandas_are_read_however_they_are_quoted(tmp_path, sep, quoting):
    table = pd.DataFrame({"x": [1.5, 2], "y": [3, 4.5], "z": [5, 6e-7], "label": [7, 8]})
    table.to_csv(tmp_path / "a.csv", sep=sep, quoting=quoting, index=False)
    cloud = read_points(tmp_path / "a.csv")
    assert_array_equal(cloud.xyz, table[["x", "y", "z"]])
    assert_array_equal(cloud.attributes["label"], [7, 8])


def test_rows_named_by_r_become_a_column_with_a_name(tmp_path):
    (tmp_path / "a.csv").write_text('"","x","y","z"\n"1",0.5,2,3\n"2",4,5,6\n')  # write.csv
    cloud = read_points(tmp_path / "a.csv")
    assert_array_equal(cloud.xyz, [[0.5, 2, 3], [4, 5, 6]])
    assert_array_equal(cloud.attributes["column_1"], [1, 2])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('"1,5","2,5","3,5"\n', "line 1 has decimal commas"),
        ('x,y,z\n1,2,3\n1,2,"312,403"\n', "line 3 has decimal commas: .* between thousands"),
        ('"x","y","z"\n"1","2","3"\n"4","wall","6"\n', "line 3: 'wall' is not a number"),
        ('"x","y","z"\n"1","2","3"\n"4","5"\n', "line 3 has 2 columns, line 2 has 3"),
    ],
)
def test_quoted_fields_that_are_no_numbers_are_named(tmp_path, text, message):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(PointFileError, match=message):
        read_points(tmp_path / "a.csv")


@pytest.mark.parametrize("first", [1_700_000_000_123_456_789, -(2**63), 2**64 - 2, 2**53])
@pytest.mark.parametrize("rest", ["0.5", "", "wall"])  # of other columns
def test_integers_beyond_double_precision_are_exact(tmp_path, first, rest):
    rows = [f"1,2,3,{n},{rest}\n" for n in (first, first + 1)]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*columns with words")
        cloud = read(tmp_path, "é\nx,y,z,t,b\n" + "\n".join(rows), encoding="latin-1")
    assert cloud.attributes["t"].tolist() == [first, first + 1]
    write_points(tmp_path / "b.txt", cloud)
    assert read_points(tmp_path / "b.txt").attributes["t"].tolist() == [first, first + 1]


@pytest.mark.parametrize("other", ["", "1.0", str(2**64), "-1"])
@pytest.mark.parametrize("order", [1, -1])
def test_integers_that_must_be_rounded_are_named(tmp_path, other, order):
    cells = [str(2**64 - 1), other][::order]
    with pytest.warns(UserWarning, match="integers of t are rounded to 53 bits"):
        cloud = read(tmp_path, "x,y,z,t\n" + "".join(f"1,2,3,{cell}\n" for cell in cells))
    assert cloud.attributes["t"].dtype == np.float64


@pytest.mark.parametrize("cell", ["1e300", "inf", str(10**20)])
def test_large_numbers_that_double_precision_holds_stay_as_they_are(tmp_path, cell):
    cloud = read(tmp_path, f"x,y,z,t\n1,2,3,5\n4,5,6,{cell}\n")
    assert_array_equal(cloud.attributes["t"], [5, float(cell)])


@pytest.mark.parametrize("extension", [".csv", ".txt", ".xyz"])
@pytest.mark.parametrize("name", ["a;b", "a,b", "a b", 'a"b', 'a", b', ";", "#a"])
def test_names_of_attributes_come_back(tmp_path, name, extension):
    path = tmp_path / f"a{extension}"
    write_points(path, PointCloud(np.eye(3), {name: np.arange(3), "q": np.arange(3) / 3}))
    back = read_points(path)
    assert list(back.attributes) == [name, "q"]
    assert_array_equal(back.attributes[name], np.arange(3))
    with pytest.raises(PointFileError, match=r"'a\\nb' has several lines"):
        write_points(path, PointCloud(np.eye(3), {"a\nb": np.arange(3)}))


# ---- comments above the rows -----------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "# SHOT TIME LONGITUDE LATITUDE ELEVATION\n9 8 13.4 52.5 3\n",
            "no x, y among .* SHOT, TI",
        ),
        ("// time ost nord hoch\n9 1 2 3\n", "no z among the columns time, ost, nord, hoch"),
        ("# by hand\n# t azimuth range v\n9 1 2 3\n", "no x, y, z among the columns t, azimuth"),
        ("#id,a,b,c\n9,1,2,3\n", "no x, y, z among the columns id, a, b, c"),
        ("#id;a;b;c\n9;1;2;3\n", "no x, y, z among the columns id, a, b, c"),
        ("#id,a,b,c\n9,1,2,3,\n", "no x, y, z among the columns id, a, b, c"),
    ],
)
def test_names_in_a_comment_that_hold_no_coordinates_are_refused(tmp_path, text, message):
    with pytest.raises(PointFileError, match=message):
        read(tmp_path, text)
    names = text.splitlines()[-2].strip("#/ ").replace(",", " ").replace(";", " ").split()
    told = dict(zip("xyz", names[-3:], strict=True))  # by which they are read
    row = [
        float(cell) for cell in text.splitlines()[-1].replace(";", " ").replace(",", " ").split()
    ]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*seem to be degrees")
        cloud = read(tmp_path, text, columns=told)
    assert_array_equal(cloud.xyz, [row[-3:]])
    assert list(cloud.attributes) == names[:-3]


@pytest.mark.parametrize(
    "comment",
    [
        "exported by CloudCompare",  # as many words as columns
        "12 points surveyed",
        "height in m",
        "punti e quota",  # e: and
        "cota y fecha",  # y: and
        "Berlin, Mitte, Nord",
        "scanned,cleaned",
        "x y z are UTM",
        "time, position and intensity of the scanner",
        "----------",
        "4,5,6",  # a row that is left out
        "4;5;6",
        "2026-05-01,scanner,A",
    ],
)
@pytest.mark.parametrize("separator", [" ", ",", ";"])
def test_other_comments_leave_the_first_three_columns_to_be_coordinates(
    tmp_path, comment, separator
):
    text = f"# {comment}\n//{comment}\n" + separator.join("123") + "\n" + separator.join("456")
    assert_array_equal(read(tmp_path, text).xyz, [[1, 2, 3], [4, 5, 6]])


def test_of_several_comments_the_one_with_a_name_for_each_column_counts(tmp_path):
    cloud = read(tmp_path, "# x y z in UTM 33\n# label z y x\n4 3 2 1\n")
    assert_array_equal(cloud.xyz, [[1, 2, 3]])
    assert_array_equal(cloud.attributes["label"], [4])


@pytest.mark.parametrize("first", ["Leica,RTC360,Berlin,A", "m,m,m,s", "a,b,c,d"])
def test_of_several_comments_the_first_that_holds_coordinates_counts(tmp_path, first):
    cloud = read(tmp_path, f"# {first}\n# z,y,x,label\n# x,y,z,other\n3,2,1,4\n")
    assert_array_equal(cloud.xyz, [[1, 2, 3]])
    assert list(cloud.attributes) == ["label"]
    with pytest.raises(PointFileError, match=f"among the columns {first.replace(',', ', ')}"):
        read(tmp_path, f"# {first}\n# scanned,by,hand,today\n3,2,1,4\n")


# ---- numbers and encodings -------------------------------------------------------------


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("header", ["", "Rechtswert Hochwert Höhe Güte\n"])
@pytest.mark.parametrize(
    "rows",
    [
        ["452348,901 5411237,258 312,403 0,5", "1,5 -2,25 3 7"],
        ["1,5 2,5 3,5 1", "0,125 1,25e3 ,5 0,25"],
        ["1 2 3 4", "5 6 7 8", "312,403 1,1 2,2 3,3"],  # the first rows do not tell
        ["1 2 3 0,5", "5 6 7 8"],
        ["5.411.234,500 1,5 3 4", "5.411.234 1,5 3 4"],
    ],
)
def test_decimal_commas_between_semicolons_or_tabs_are_read(tmp_path, separator, header, rows):
    text = header + "\n".join(rows)
    cloud = read(tmp_path, text.replace(" ", separator))
    truth = [[float(c.replace(".", "").replace(",", ".")) for c in r.split()] for r in rows]
    found = np.c_[cloud.xyz, cloud.attributes["Güte" if header else "column_4"]]
    assert_array_equal(found, truth)


@pytest.mark.parametrize("part", [1, 2, 100])
@pytest.mark.parametrize(
    ("rows", "line", "sign"),
    [
        (["1,5;2;3", "312.403;2;3"], 2, "comma"),  # thousands, as in German
        (["1,5;2;3", "1.5;2;3"], 2, "comma"),
        (["1.5;2;3", "4;5;6", "312,403;2;3"], 3, "point"),
        (["1;2;3", "4;5.0;6", "4;5;6,5"], 3, "point"),
        (["452,345.6;2;3", "4;5;6,5"], 2, "point"),
    ],
)
def test_rows_with_another_decimal_sign_are_refused_by_their_line(
    tmp_path, monkeypatch, rows, line, sign, part
):
    monkeypatch.setattr(_text, "ROWS_A_TIME", part)
    with pytest.raises(PointFileError, match=f"line {line}: .* with a decimal {sign}, as those"):
        read(tmp_path, "\n".join(rows))


@pytest.mark.parametrize("part", [1, 2, 100])
@pytest.mark.parametrize(
    ("rows", "truth"),
    [
        (["1;2;3;0.5", "1,5;2;3;0.5"], [[1, 2, 3, 0.5], [1.5, 2, 3, 0.5]]),
        (
            ["1;2;3;0.5", "4;5;6;7", "1,5;2;3;1.234"],
            [[1, 2, 3, 0.5], [4, 5, 6, 7], [1.5, 2, 3, 1.234]],
        ),
        (["1;2;3;0,5", "1.5;2;3;0,25"], [[1, 2, 3, 0.5], [1.5, 2, 3, 0.25]]),
        (["1,5;2;3;0.5", "7;8;9;0.25"], [[1.5, 2, 3, 0.5], [7, 8, 9, 0.25]]),
        (["1;2;3;0.5", "4;5;6;1.5"], [[1, 2, 3, 0.5], [4, 5, 6, 1.5]]),
        (["1;2;3;0,5", "4,5;5;6;1,5"], [[1, 2, 3, 0.5], [4.5, 5, 6, 1.5]]),
    ],
)
def test_the_sign_of_an_attribute_decides_no_coordinates(tmp_path, monkeypatch, rows, truth, part):
    monkeypatch.setattr(_text, "ROWS_A_TIME", part)
    cloud = read(tmp_path, "\n".join(rows))
    assert_array_equal(np.c_[cloud.xyz, cloud.attributes["column_4"]], truth)


@pytest.mark.parametrize("part", [1, 100])
@pytest.mark.parametrize(
    "rows", [["1;2;3;0,5", "1,5;2;3;4", "1.5;2;3;4"], ["1;2;3;0.5", "1,5;2;3;4", "1.5;2;3;4"]]
)
def test_coordinates_have_one_sign_whatever_attributes_have(tmp_path, monkeypatch, rows, part):
    monkeypatch.setattr(_text, "ROWS_A_TIME", part)
    with pytest.raises(
        PointFileError, match=r"line 3: '1\.5' is not a number with a decimal comma"
    ):
        read(tmp_path, "\n".join(rows))


@pytest.mark.parametrize("part", [1, 100])
@pytest.mark.parametrize(
    ("rows", "line"),
    [
        (['"345,678";"567,890";12'], 1),
        (["345;567;12", '1;"-567,890";12'], 2),
        (["x;y;z;i", '1;2;3;"12,345"'], 2),
    ],
)
def test_thousands_or_decimals_in_quotes_are_asked_for(tmp_path, monkeypatch, rows, line, part):
    monkeypatch.setattr(_text, "ROWS_A_TIME", part)
    with pytest.raises(PointFileError, match=f"line {line}: are there thousands or decimals"):
        read(tmp_path, "\n".join(rows))


@pytest.mark.parametrize(
    ("row", "truth"),
    [
        ("345,678;567,890;12", [345.678, 567.89, 12]),  # no spreadsheet leaves thousands so
        ('"1,5";"567,890";"12,125"', [1.5, 567.89, 12.125]),  # the first is beyond doubt
        ('"452348,901";"567,890";12', [452348.901, 567.89, 12]),
        ('"0,125";"567,890";12', [0.125, 567.89, 12]),
        ('"5,411,234";"1.5";12', [5411234, 1.5, 12]),
    ],
)
def test_commas_beyond_doubt_are_read_in_quotes(tmp_path, row, truth):
    assert_array_equal(read(tmp_path, row).xyz, [truth])


@pytest.mark.parametrize("part", [1, 100])
@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize(
    ("mark", "encoding"),
    [*((mark, "utf-8") for mark in "'\u2019\xa0\u202f"), ("\u2019", "cp1252"), ("\xa0", "cp1252")],
)
@pytest.mark.parametrize("decimal", [".", ","])
def test_thousands_of_swiss_and_french_are_read(
    tmp_path, monkeypatch, mark, decimal, separator, encoding, part
):
    monkeypatch.setattr(_text, "ROWS_A_TIME", part)
    rows = ["E;N;H;i", "1^347^452.548;-567^890.1;412;1^000", "452^347;567^890.25;412.5;2"]
    text = "\n".join(rows).replace(".", decimal).replace("^", mark).replace(";", separator)
    (tmp_path / "a.txt").write_bytes(text.encode(encoding))
    cloud = read_points(tmp_path / "a.txt")
    assert_array_equal(cloud.xyz, [[1347452.548, -567890.1, 412], [452347, 567890.25, 412.5]])
    assert_array_equal(cloud.attributes["i"], [1000, 2])


@pytest.mark.parametrize("cell", ["45'23", "1'234'56", "0'123.5", "1'234\xa0567", "1234'567", "5'"])
def test_marks_that_separate_no_thousands_are_no_number(tmp_path, cell):
    with pytest.raises(PointFileError, match=r"line 2: .* is not a number"):
        read(tmp_path, f"1;2;3\n{cell};2;3\n")


@pytest.mark.parametrize("text", ["1,5 2,5 3,5\n", "1,5\n", "x y z\n1,5 2 3\n", '"1,5","2","3"\n'])
def test_decimal_commas_where_commas_may_separate_columns_are_refused(tmp_path, text):
    with pytest.raises(PointFileError, match=r"decimal commas: replace|2 column|names 3 columns"):
        read(tmp_path, text)


def test_numbers_of_other_programs_are_read_in_all_parts(tmp_path, monkeypatch):
    monkeypatch.setattr(_text, "ROWS_A_TIME", 2)
    rows = ["1.0D+00,2,3,4", '"5,411,234.500",2,3,4', "1,2,3,-1.#IND", "1,2,3,1.#INF # far"]
    rows += ["1.#QNAN,2,3,4", "-nan(ind),2,3,4", "1,2,3,-1.#INF00"]
    cloud = read(tmp_path, "\n".join(rows))
    assert_array_equal(cloud.xyz[:, 0], [1, 5411234.5, 1, 1, 1])
    assert_array_equal(cloud.attributes["column_4"], [4, 4, np.nan, np.inf, -np.inf])
    assert cloud.n_dropped == 2


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be", "utf-8"])
def test_a_byte_order_mark_tells_the_encoding(tmp_path, encoding):
    large = 2**60 + 1  # is read a second time
    cloud = read(tmp_path, f"\ufeffRechtswert;Hochwert;Höhe;Zeit\n1,5;2;3;{large}\n", encoding)
    assert_array_equal(cloud.xyz, [[1.5, 2, 3]])
    assert cloud.attributes["Zeit"].tolist() == [large]


@pytest.mark.parametrize("tail", [b"1\x002", b"\x00\xd8\x00\xd8", b"\0\0" * 9])
def test_damaged_utf_16_gets_one_clear_line(tmp_path, tail):
    (tmp_path / "a.csv").write_bytes("\ufeff1,2,3\n".encode("utf-16-le") + tail)
    with pytest.raises(PointFileError, match=r"damaged or is of another|line 2 has 1 col") as told:
        read_points(tmp_path / "a.csv")
    assert "\n" not in str(told.value)


# ---- counts of points ------------------------------------------------------------------


@pytest.mark.parametrize("part", [1, 3, 100])
def test_a_count_begins_each_scan(tmp_path, monkeypatch, part):
    monkeypatch.setattr(_text, "ROWS_A_TIME", part)
    text = "0\n2\n1 2 3 7\n\n4 5 6 8\n0\n3\n1 2 3 9\n1 2 3 10 # last\n1 2 3 11\n# the end\n\n"
    cloud = read(tmp_path, text)
    assert_array_equal(cloud.attributes["scan_index"], [1, 1, 3, 3, 3])
    assert_array_equal(cloud.attributes["column_4"], [7, 8, 9, 10, 11])
    assert "scan_index" not in read(tmp_path, text[: text.index("0\n3")]).attributes


@pytest.mark.parametrize("part", [1, 3, 100])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2\n1 2 3\n", "line 1 promises 2 points, found 1"),
        ("1\n1 2 3\n4 5 6\n", "line 1 promises 1 point, line 3 is one more"),
        ("1\n1 2 3\n3\n4 5 6\n", "line 3 promises 3 points, found 1"),
        ("1\n1 2 3\n1\n4 5 6\n7 8 9\n", "line 3 promises 1 point, line 5 is one more"),
        ("2\n1 2 3\n1\n4 5 6\n", "line 3 has 1 columns, line 2 has 3; line 1 promises 2 points"),
    ],
)
def test_a_wrong_count_is_named_with_its_line(tmp_path, monkeypatch, text, message, part):
    monkeypatch.setattr(_text, "ROWS_A_TIME", part)
    with pytest.raises(PointFileError, match=message):
        read(tmp_path, text)


# ---- how fast it is --------------------------------------------------------------------


@pytest.mark.parametrize("rows", ["1.5 2 3", "1.5;2;3", "1,5;2;3", "1.5D0,2,3", "1.5,2,3 # c"])
def test_no_cells_are_read_one_by_one_where_numpy_can_read_the_rows(tmp_path, monkeypatch, rows):
    monkeypatch.setattr(_text._Table, "_slow", None)
    if rows in ("1.5 2 3", "1.5;2;3"):  # nor are lines changed
        monkeypatch.setattr(_text, "plain_numbers", None)
    monkeypatch.setattr(_text, "ROWS_A_TIME", 2)
    assert_array_equal(read(tmp_path, f"{rows}\n" * 5).xyz, [[1.5, 2, 3]] * 5)

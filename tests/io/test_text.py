"""Text however it is laid out."""

import csv

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import PointFileError, read_points

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
        ('x;y;z\n"1,5";"2,5";"3,5"\n', "line 2 has decimal commas"),
        ('"x","y","z"\n"1","2","3"\n"4","wall","6"\n', "line 3: 'wall' is not a number"),
        ('"x","y","z"\n"1","2","3"\n"4","5"\n', "line 3 has 2 columns, line 2 has 3"),
    ],
)
def test_quoted_fields_that_are_no_numbers_are_named(tmp_path, text, message):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(PointFileError, match=message):
        read_points(tmp_path / "a.csv")

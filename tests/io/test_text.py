"""Text however it is laid out."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import read_points

TEXTS = {
    "spaces": "1  2 3.5 4\n 5 6 7  8\n",
    "tabs with header": "X\tY\tZ\tlabel\n1\t2\t3.5\t4\n5\t6\t7\t8\n",
    "commas with header": "x,y,z,label\n1,2,3.5,4\n5,6,7,8",
    "semicolons": "1;2;3.5;4\r\n5;6;7;8\r\n",
    "byte order mark": "\ufeffx,y,z,label\n1,2,3.5,4\n5,6,7,8\n",
    "comment header": "//X Y Z label\n1 2 3.5 4\n5 6 7 8\n",
    "other order": "label;z;y;x\n4;3.5;2;1\n8;7;6;5\n",
    "comments and blanks": "# a survey\n\n1 2 3.5 4\n\n5 6 7 8 # last\n",
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

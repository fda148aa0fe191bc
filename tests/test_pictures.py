"""The pages of pictures: each picture is there, small, described, and made by a script."""

import re
from pathlib import Path

import numpy as np
import pytest

DOCS = Path(__file__).parents[1] / "docs"
PAGES = {"choosing": "figures_choosing.py", "failure": "figures_failure.py"}


def pictures():
    for page in PAGES:
        text = (DOCS / f"{page}.rst").read_text(encoding="utf-8")
        for name, options in re.findall(r"^\.\. image:: (\S+)\n((?:   .*\n)*)", text, re.M):
            yield pytest.param(page, name, options, id=Path(name).stem)


@pytest.mark.parametrize(("page", "name", "options"), list(pictures()))
def test_a_picture_is_small_described_and_made_by_a_script(page, name, options):
    assert (DOCS / name).stat().st_size < 150_000
    assert re.search(r"^   :alt: \S", options)
    script = (DOCS / PAGES[page]).read_text(encoding="utf-8")
    assert f'"{Path(name).stem}"' in script


def test_the_remedy_for_mixed_pixels_runs_and_marks_them():
    text = (DOCS / "failure.rst").read_text(encoding="utf-8")
    block = text.split(".. code-block:: python\n", 1)[1].split("\nIn the picture", 1)[0]
    names = {}
    exec("\n".join(line[4:] for line in block.splitlines()), names)
    street, suspect = names["street"], names["suspect"]
    mixed = street.outlier_kind == street.outlier_kind_names.index("mixed_pixel")
    high = street.data[:, 2] > 0.2
    assert suspect[mixed & high].mean() > 0.9
    assert suspect[high & (street.target == 1)].mean() < 0.01


def test_the_table_of_trials_is_equation_13():
    text = (DOCS / "choosing.rst").read_text(encoding="utf-8")
    rows = re.findall(r"^P\\ :sub:`r` (0\.\d+) +(.*)$", text, re.M)
    assert len(rows) == 3
    for probability, cells in rows:
        found = [int(cell.strip("*")) for cell in cells.split()]
        good = (1 - np.arange(0.1, 0.75, 0.1)) ** 3
        expected = np.ceil(np.log1p(-float(probability)) / np.log1p(-good))
        assert found == expected.astype(int).tolist()

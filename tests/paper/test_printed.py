"""The paper's printed numbers agree with each other where they can, and where not it is said."""

import pytest

from benchmarks.paper._classification import flagged_in_paper
from benchmarks.paper._printed import (
    ANGLES,
    CLASSIFICATION,
    OUTLIERS,
    SHARES,
    STATISTICS,
)

ROWS = [(name, share) for name in CLASSIFICATION for share in SHARES]


@pytest.mark.parametrize(("name", "share"), ROWS)
def test_the_rates_of_table_4_add_up_within_their_rounding(name, share):
    found, kept, swamped, masked, accuracy = CLASSIFICATION[name][share]
    assert kept + swamped == pytest.approx(100, abs=0.1001)
    assert found + masked == pytest.approx(100, abs=0.1001)
    # Rates are printed to a tenth.
    assert accuracy == pytest.approx((share * found + (100 - share) * kept) / 100, abs=0.08)


@pytest.mark.parametrize(
    ("name", "counts"), [("uLSIF", (7.0, 23.0, 46.0)), ("qSp", (8.0, 30.0, 40.0))]
)
def test_ulsif_and_qsp_flag_whole_numbers_of_points(name, counts):
    for share, count in zip(SHARES, counts, strict=True):
        found, kept = CLASSIFICATION[name][share][:2]
        flagged = (found * share + (100 - kept) * (100 - share)) / 100
        assert flagged == pytest.approx(count, abs=0.11)
        assert flagged_in_paper(name, share) == count


@pytest.mark.parametrize("law", OUTLIERS)
def test_the_statistics_of_table_1_are_in_order(law):
    for name, laws in ANGLES.items():
        values = dict(zip(STATISTICS, laws[law], strict=True))
        assert 0 <= values["min"] <= values["median"] <= values["max"] <= 90, name
        assert values["min"] <= values["mean"] <= values["max"], name
        assert values["QR"] < values["max"] - values["min"], name

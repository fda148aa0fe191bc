"""Attributes in a page: what is a class, what is a number, and how exact it stays."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sklearn_mcmd.view._attributes import NumberCode, code_normals, plan_attributes

numbers = arrays(np.float64, st.integers(1, 100), elements=st.floats(-1e12, 1e12))


def plan(**columns):
    sources, constants, skipped = plan_attributes([columns])
    return {source.info["name"]: source for source in sources}, constants[0], skipped


def decoded(code, codes):
    """The values of codes, as the page computes them."""
    values = code.low + code.step * (codes.astype(np.float64) - 1)
    return values if code.width is None else code.center + code.width * np.sinh(values)


@given(numbers)
@example(np.array([8388608, 0, 0, 4.67e-302, 4.67e-302]))
@example(np.array([1, 0, 0, 5e-324, 5e-324]))
def test_a_number_is_within_the_stated_error(values):
    code = NumberCode.for_values(values)
    codes = code.encode(values)
    assert codes.min() >= 1
    told = code.info(exact=False)
    reach = 1.01 * (
        told["error"] + told.get("relative", 0) * np.abs(values - told.get("center", 0))
    )
    rounding = 1e-9 * np.abs(values).max()
    assert (np.abs(decoded(code, codes) - values) <= reach + rounding + 1e-300).all()


def test_scores_with_a_long_tail_keep_their_small_values_apart():
    rng = np.random.default_rng(0)
    scores = np.r_[rng.gamma(2, 0.5, 1000), 1e6, 1e9]
    code = NumberCode.for_values(scores)
    values = decoded(code, code.encode(scores))
    np.testing.assert_allclose(values[:1000], scores[:1000], atol=0.002)
    np.testing.assert_allclose(values[1000:], scores[1000:], rtol=1e-3)
    assert (np.diff(code.encode(np.sort(scores)).astype(int)) >= 0).all()


def test_nan_and_infinity_have_no_value():
    sources, _, _ = plan(score=np.array([0.5, np.nan, np.inf, 2.25]), none=np.full(4, np.nan))
    codes = sources["score"].codes[0][0]
    np.testing.assert_array_equal(codes == 0, [False, True, True, False])
    assert sources["none"].codes[0][0].tolist() == [0] * 4


@pytest.mark.parametrize(
    ("name", "values", "classes", "names", "outliers"),
    [
        ("kind", [5, -1, 5, 300], [-1, 5, 300], {}, None),
        ("outlier", [0.0, 1.0, 1.0], [0, 1], {"0": "regular", "1": "outlier"}, [1]),
        ("classification", [2, 7, 18, 6], [2, 6, 7, 18], {"7": "noise"}, [2, 3]),
        ("region", np.arange(3000) % 1500 - 1, [*range(-1, 1499)], {"-1": "none"}, None),
        ("half", [0.5, 1, 1.5, 2], None, {}, None),
        ("intensity", np.arange(3000) % 1500, None, {}, None),
    ],
)
def test_few_whole_numbers_and_labels_are_classes_with_exact_values_and_names(
    name, values, classes, names, outliers
):
    source = plan(**{name: np.array(values)})[0][name]
    info, (codes,) = source.info, source.codes[0]
    assert info["kind"] == ("number" if classes is None else "class")
    assert info.get("values") == classes
    assert names.items() <= info.get("names", {}).items()
    assert info.get("outliers") == outliers
    if classes is not None:
        np.testing.assert_array_equal(np.array(classes)[codes], values)
    elif name == "intensity":
        assert info["error"] == 0.0
        np.testing.assert_array_equal(codes - 1 + info["low"], values)


@given(arrays(np.float64, (20, 3), elements=st.floats(-1, 1)))
def test_a_normal_is_within_0_06_degrees(vectors):
    vectors = vectors[np.linalg.norm(vectors, axis=1) > 1e-3]
    for true, u, v in zip(vectors, *code_normals(vectors), strict=True):
        decoded = normal_of(int(u), int(v))
        sine = np.linalg.norm(np.cross(decoded, true / np.linalg.norm(true)))
        assert np.degrees(np.arcsin(min(sine, 1.0))) < 0.06
        assert decoded @ true > 0


def normal_of(u, v):
    x, y = (u - 1) / 2047 - 1, (v - 1) / 2047 - 1
    z = 1 - abs(x) - abs(y)
    if z < 0:
        x, y = (1 - abs(y)) * np.copysign(1, x), (1 - abs(x)) * np.copysign(1, y)
    return np.array([x, y, z]) / np.linalg.norm([x, y, z])


def test_axes_are_exact_and_missing_normals_have_no_code():
    axes = np.vstack([np.eye(3), -np.eye(3)])
    decoded = [normal_of(int(u), int(v)) for u, v in zip(*code_normals(axes), strict=True)]
    np.testing.assert_allclose(decoded, axes, atol=1e-12)
    u, v = code_normals([[0, 0, 0], [np.nan, 1, 0], [0, np.inf, 0]])
    assert u.tolist() == v.tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("scale", "dtype"), [(1, np.uint8), (257, np.uint16), (1 / 255, np.float32)]
)
def test_colors_of_8_and_16_bits_and_shares_are_equal_in_the_page(scale, dtype):
    bits = np.array([[0, 128, 255], [7, 8, 9]])
    names = ("red", "green", "blue")
    columns = {name: (scale * bits[:, i]).astype(dtype) for i, name in enumerate(names)}
    sources, _, _ = plan(**columns)
    assert list(sources) == ["color"]
    np.testing.assert_array_equal(np.column_stack(sources["color"].codes[0]), bits)


def test_what_is_equal_for_all_points_is_told_once_and_text_is_left_out():
    sources, constants, skipped = plan(
        user_data=np.zeros(3, np.uint8),
        name=np.array(["a", "b", "c"]),
        normals=np.eye(3),
        moments=np.arange(6.5, 12).reshape(3, 2),
    )
    assert list(sources) == ["normal", "moments_0", "moments_1"]
    assert (constants, skipped) == ({"user_data": 0}, ["name"])


def test_clouds_share_classes_and_ranges():
    first, second = {"region": np.array([0, 1]), "a": np.array([0.5, 1])}, {"region": np.array([7])}
    sources, _, _ = plan_attributes([first, second])
    by_name = {source.info["name"]: source for source in sources}
    assert by_name["region"].info["values"] == [0, 1, 7]
    assert by_name["region"].codes[1][0].tolist() == [2]
    assert by_name["a"].codes[1] is None

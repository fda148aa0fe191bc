"""Attributes in a page: what is a class, what is a number, and how exact it stays."""

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pages import read_page
from sklearn_mcmd.io import PointCloud
from sklearn_mcmd.plotting import view

numbers = arrays(np.float64, st.integers(1, 100), elements=st.floats(-1e12, 1e12))


def in_page(*clouds, **columns):
    """What a page says of attributes, their codes in the order of points, and what is constant."""
    clouds = [
        PointCloud(np.arange(3.0 * len(first)).reshape(-1, 3), attributes)
        for attributes in clouds or [columns]
        for first in [next(iter(attributes.values()))]
    ]
    manifest, shown = read_page(view(*clouds).html)
    codes = [
        {
            name: [part[np.argsort(one.rows)] for part in parts]
            for name, parts in one.columns.items()
        }
        for one in shown
    ]
    infos = {info["name"]: info for info in manifest["attributes"]}
    return infos, codes if len(clouds) > 1 else codes[0], manifest["clouds"][0]["constants"]


def decoded(info, codes):
    """The values of codes, as the page computes them."""
    values = info["low"] + info["step"] * (codes.astype(np.float64) - 1)
    return info["center"] + info["width"] * np.sinh(values) if "width" in info else values


@given(numbers)
@settings(max_examples=60)
@example(np.array([8388608.5, 0, 0, 4.67e-302, 4.67e-302]))
@example(np.array([1.5, 0, 0, 5e-324, 5e-324]))
def test_a_number_is_within_the_stated_error(values):
    infos, codes, _ = in_page(a=values)
    assume(infos and infos["a"]["kind"] == "number")
    (codes,), info = codes["a"], infos["a"]
    assert codes.min() >= 1
    reach = info["error"] + info.get("relative", 0) * np.abs(values - info.get("center", 0))
    rounding = 1e-9 * np.abs(values).max()
    assert (np.abs(decoded(info, codes) - values) <= 1.01 * reach + rounding + 1e-300).all()


def test_scores_with_a_long_tail_keep_their_small_values_apart():
    rng = np.random.default_rng(0)
    scores = np.sort(np.r_[rng.gamma(2, 0.5, 1000), 1e6, 1e9])
    infos, codes, _ = in_page(score=scores)
    values = decoded(infos["score"], codes["score"][0])
    np.testing.assert_allclose(values[:1000], scores[:1000], atol=0.002)
    np.testing.assert_allclose(values[1000:], scores[1000:], rtol=1e-3)
    assert (np.diff(codes["score"][0].astype(int)) >= 0).all()


def test_nan_and_infinity_have_no_value():
    _, codes, _ = in_page(score=np.array([0.5, np.nan, np.inf, 2.25]), none=np.full(4, np.nan))
    np.testing.assert_array_equal(codes["score"][0] == 0, [False, True, True, False])
    assert codes["none"][0].tolist() == [0] * 4


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
    infos, codes, _ = in_page(**{name: np.array(values)})
    (codes,), info = codes[name], infos[name]
    assert info["kind"] == ("number" if classes is None else "class")
    assert info.get("values") == classes
    assert names.items() <= info.get("names", {}).items()
    assert info.get("outliers") == outliers
    if classes is not None:
        np.testing.assert_array_equal(np.array(classes)[codes], values)
    elif name == "intensity":
        assert info["error"] == 0.0
        np.testing.assert_array_equal(codes - 1 + info["low"], values)


def normal_of(u, v):
    x, y = (u - 1) / 2047 - 1, (v - 1) / 2047 - 1
    z = 1 - abs(x) - abs(y)
    if z < 0:
        x, y = (1 - abs(y)) * np.copysign(1, x), (1 - abs(x)) * np.copysign(1, y)
    return np.array([x, y, z]) / np.linalg.norm([x, y, z])


@given(arrays(np.float64, (20, 3), elements=st.floats(-1, 1)))
@settings(max_examples=60)
def test_a_normal_is_within_0_06_degrees(vectors):
    vectors = vectors[np.linalg.norm(vectors, axis=1) > 1e-3]
    assume(len(vectors))
    _, codes, _ = in_page(normals=vectors)
    for true, u, v in zip(vectors, *codes["normal"], strict=True):
        normal = normal_of(int(u), int(v))
        sine = np.linalg.norm(np.cross(normal, true / np.linalg.norm(true)))
        assert np.degrees(np.arcsin(min(sine, 1.0))) < 0.06
        assert normal @ true > 0


def test_axes_are_exact_and_missing_normals_have_no_code():
    missing = [[0, 0, 0], [np.nan, 1, 0], [0, np.inf, 0]]
    axes = np.vstack([np.eye(3), -np.eye(3)])
    u, v = in_page(normals=np.vstack([axes, missing]))[1]["normal"]
    normal = [normal_of(int(a), int(b)) for a, b in zip(u[:6], v[:6], strict=True)]
    np.testing.assert_allclose(normal, axes, atol=1e-12)
    assert u[6:].tolist() == v[6:].tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("scale", "dtype"), [(1, np.uint8), (257, np.uint16), (1 / 255, np.float32)]
)
def test_colors_of_8_and_16_bits_and_shares_are_equal_in_the_page(scale, dtype):
    bits = np.array([[0, 128, 255], [7, 8, 9]])
    columns = dict(zip(("red", "green", "blue"), (scale * bits).astype(dtype).T, strict=True))
    infos, codes, _ = in_page(**columns)
    assert list(infos) == ["color"]
    np.testing.assert_array_equal(np.column_stack(codes["color"]), bits)


def test_what_is_equal_for_all_points_is_told_once_and_text_is_left_out():
    columns = {"user_data": np.zeros(3, np.uint8), "name": np.array(["a", "b", "c"])}
    columns |= {"normals": np.eye(3), "moments": np.arange(6.5, 12).reshape(3, 2)}
    with pytest.warns(UserWarning, match="hold no numbers are left out: name"):
        infos, _, constants = in_page(**columns)
    assert list(infos) == ["normal", "moments_0", "moments_1"]
    assert constants == {"user_data": 0}


def test_clouds_share_classes_and_ranges():
    first = {"region": np.array([0, 1, 1]), "a": np.array([0.5, 1, 2])}
    infos, (_, second), _ = in_page(first, {"region": np.array([7, 7])})
    assert infos["region"]["values"] == [0, 1, 7]
    assert second["region"][0].tolist() == [2, 2]
    assert "a" not in second

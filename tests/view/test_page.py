"""The page is complete, asks for nothing from outside, and takes no name for HTML."""

import base64
import hashlib
import html
import re

import numpy as np
import pytest

from pages import read_page
from sklearn_mcmd.io import PointCloud, write_points
from sklearn_mcmd.plotting import view
from sklearn_mcmd.view import CloudPage

ODD = "</script><img src=x onerror=alert(1)>&\"'\u2028<!--data-->"


def shown_in(page, *clouds):
    """What a page says, and its clouds, whose coordinates are as exact as it says."""
    manifest, shown = read_page(page.html)
    for cloud, one in zip(clouds, shown, strict=True):
        xyz = np.array(manifest["low"]) + manifest["step"] * one.steps
        assert np.abs(xyz - cloud[one.rows]).max() <= manifest["error"] + 1e-9
    assert manifest["error"] == page.error
    return manifest, *shown


def test_points_values_and_rows_are_those_of_the_cloud(cloud):
    manifest, shown = shown_in(view(cloud), cloud.xyz)
    region = next(a for a in manifest["attributes"] if a["name"] == "region")
    values = np.array(region["values"])[shown.columns["region"][0]]
    np.testing.assert_array_equal(values, cloud.attributes["region"][shown.rows])
    assert manifest["start"] == "region"


def test_a_stray_point_leaves_coordinates_exact_and_what_the_picture_rounds_is_told():
    xyz = np.round(np.random.default_rng(0).uniform(size=(1000, 3)), 3)
    near = view(xyz)
    xyz[0] = [1e6, 0, 5e3]
    page = view(xyz)
    manifest, shown = shown_in(page, xyz)
    places = (shown.steps.astype(np.int64) - manifest["middle"]) * manifest["step"]
    rounded = np.abs(places.astype(np.float32) - places)
    assert near.drawn_error < 1e-7
    assert rounded.max() <= page.drawn_error == manifest["drawn"] == 2.0**-5
    assert np.median(rounded) < 1e-7  # the others are drawn where they are
    assert manifest["heights"][1] < 3_000  # steps of a millimeter: colors serve the others


def test_nothing_is_loaded_from_outside(cloud):
    page = view(cloud).html
    urls = set(re.findall(r"(?:https?:)?//[\w.-]+\.\w+[\w/.]*", page.split('class="block"')[0]))
    urls |= set(re.findall(r"https?://[^\"'\s<]+", page))
    assert urls <= {"http://www.w3.org/2000/svg"}  # a name, not an address
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1].split("; ")
    assert {"default-src 'none'", "base-uri 'none'", "form-action 'none'"} <= set(policy)
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy  # its own script, and no other
    assert not re.search(r"<(script|img|iframe)[^>]*\ssrc=|@import|fetch\(|XMLHttpRequest", page)


def test_names_that_look_like_html_are_harmless(cloud):
    odd = PointCloud(cloud.xyz, {ODD: cloud.attributes["score"], "region": np.arange(40) % 3})
    page = view(odd, names=[ODD], title=ODD).html
    plain = view(cloud).html
    assert page.count("<script") == page.count("</script>")
    assert "<img" not in page
    manifest, (shown,) = read_page(page)
    assert manifest["title"] == manifest["clouds"][0]["name"] == ODD
    assert ODD in shown.columns
    assert len(re.findall("<!--", page)) == len(re.findall("<!--", plain))


@pytest.mark.filterwarnings("ignore:the page holds .* chosen at random")
def test_too_many_points_are_thinned_and_that_is_said(cloud):
    with pytest.warns(UserWarning, match="the page holds 10 of 40 points, chosen at random"):
        page = view(cloud, max_points=10)
    assert page.spacing > view(cloud).spacing  # of the points that were kept
    manifest, shown = shown_in(page, cloud.xyz)
    assert (page.n_points, page.n_shown, len(set(shown.rows.tolist()))) == (40, 10, 10)
    assert manifest["clouds"][0]["total"] == 40
    xyz = np.random.default_rng(0).uniform(size=(1000, 3))
    page = view(xyz, xyz[:1], xyz[:2], max_points=3)
    assert [len(one.rows) for one in shown_in(page, xyz, xyz[:1], xyz[:2])[1:]] == [1, 1, 1]
    assert view(xyz, xyz[:300], max_points=100).n_shown in (99, 100)


def test_two_clouds_keep_their_attributes_and_share_the_grid(cloud):
    other = PointCloud(cloud.xyz[:7] + 1, {"score": cloud.attributes["score"][:7]})
    page = view(cloud, other, names=["a", "b"])
    manifest, first, second = shown_in(page, cloud.xyz, other.xyz)
    assert [one["name"] for one in manifest["clouds"]] == ["a", "b"]
    assert set(second.columns) == {"score"} < set(first.columns)
    assert manifest["title"] == "a, b"


def test_files_and_arrays_can_be_shown(tmp_path, cloud):
    write_points(tmp_path / "scan.csv", cloud)
    page = view(tmp_path / "scan.csv", cloud.xyz.tolist())
    assert [told["name"] for told in read_page(page.html)[0]["clouds"]] == ["scan.csv", "cloud 2"]


def test_attributes_and_the_first_color_can_be_chosen(cloud):
    _, (shown,) = read_page(view(cloud, only=["normal_x", "score"]).html)
    assert set(shown.columns) == {"normal", "score"}
    assert read_page(view(cloud, color="height").html)[0]["start"] == "height"
    assert read_page(view(cloud.xyz).html)[0]["start"] == "height"


def test_each_attribute_has_a_name_of_its_own(cloud):
    rng = np.random.default_rng(0)
    with_height = PointCloud(cloud.xyz, {"height": rng.uniform(size=40)})
    manifest, _ = read_page(view(with_height, color="height").html)
    assert (manifest["start"], manifest["own_height"]) == ("height", "height (2)")
    assert read_page(view(with_height, color="height (2)").html)[0]["start"] == "height (2)"
    assert read_page(view(with_height).html)[0]["start"] == "height (2)"
    bits = {name: np.arange(40, dtype=np.uint8) for name in ("red", "green", "blue")}
    clouds = (PointCloud(cloud.xyz, bits), PointCloud(cloud.xyz, {"color": rng.uniform(size=40)}))
    manifest, (first, second) = read_page(view(*clouds).html)
    assert [a["name"] for a in manifest["attributes"]] == ["color (2)", "color"]
    assert (set(first.columns), set(second.columns)) == ({"color (2)"}, {"color"})


def test_rows_are_those_of_the_array_also_after_points_that_are_left_out(tmp_path):
    xyz = np.round(np.random.default_rng(0).uniform(size=(20, 3)), 3)
    xyz[3] = np.nan
    with pytest.warns(UserWarning, match="1 point without finite coordinates is left out"):
        manifest, _ = shown_in(page := view(xyz), xyz)
    assert (page.n_shown, manifest["clouds"][0]["dropped"]) == (19, 0)
    np.savetxt(tmp_path / "scan.xyz", xyz)
    read, _ = read_page(view(tmp_path / "scan.xyz").html)
    assert read["clouds"][0]["dropped"] == 1  # the reader left it out: the card says so


@pytest.mark.filterwarnings("ignore:2 points without")
@pytest.mark.parametrize("empty", [[np.empty((0, 3))], [np.full((2, 3), np.nan)], []])
def test_an_empty_cloud_and_no_cloud_are_refused(empty):
    with pytest.raises(ValueError, match="cannot be shown" if empty else "at least one cloud"):
        view(*empty)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"names": []}, "names must have one entry for each of 2 clouds"),
        ({"names": "ab"}, "names must have one entry for each of 2 clouds, got 'ab'"),
        ({"max_points": 1}, "max_points must be at least the number of clouds, 2, got 1"),
        ({"max_points": 0}, "max_points must be a whole number of at least 1"),
        ({"max_points": 2.5}, "max_points must be a whole number of at least 1, got 2.5"),
        ({"height": '"><script>'}, "height must be a whole number of at least 1"),
        ({"height": -1}, "height must be a whole number of at least 1"),
        ({"only": "score"}, "only must be a collection of names"),
        ({"only": ["nothing"]}, "no cloud has an attribute 'nothing'"),
        ({"color": "hue"}, "no attribute 'hue' to color by; there are"),
    ],
)
def test_wrong_arguments_are_refused_by_name(wrong, message):
    with pytest.raises(ValueError, match=message):
        view(np.eye(3), np.eye(3), **wrong)


def test_coordinates_that_no_page_can_hold_are_refused_by_the_name_of_the_cloud():
    with pytest.raises(ValueError, match=r"huge: x reaches from -1e\+308 to 1e\+308"):
        view(1e308 * np.array([[1.0, 0, 0], [-1, 0, 0]]), names=["huge"])


def test_in_jupyter_the_page_is_a_frame(cloud):
    page = view(cloud, height=321)
    frame = page._repr_html_()
    assert html.unescape(re.search(r'srcdoc="([^"]*)"', frame)[1]) == page.html
    assert "height:321px" in frame
    assert "allow-same-origin" not in frame
    assert repr(page) == "CloudPage(40 of 40 points, 0.1 MB)"


def test_a_page_is_saved_completely_or_not_at_all(tmp_path, cloud, monkeypatch):
    page = view(cloud)
    path = page.save(tmp_path / "a.html")
    assert path.read_text(encoding="utf-8") == page.html
    monkeypatch.setattr(CloudPage, "html", property(lambda self: 1 / 0), raising=False)
    with pytest.raises(ZeroDivisionError):
        CloudPage.__new__(CloudPage).save(tmp_path / "a.html")
    for name, message in [
        ("page.laz", r"ends in \.html"),
        ("page", r"ends in \.html"),
        ("missing/page.html", "does not exist"),
    ]:
        with pytest.raises(ValueError, match=message):
            page.save(tmp_path / name)
    assert [p.name for p in tmp_path.iterdir()] == ["a.html"]
    assert path.stat().st_size > 1000

"""Links from the HTML form of an estimator to its page of the API."""

import tomllib
from pathlib import Path

import pytest
from sklearn.pipeline import make_pipeline
from sklearn.utils import estimator_html_repr

from public import ESTIMATORS
from sklearn_mcmd import RegionGrowing, RobustNormalEstimator, _sklearn
from test_docs import documented

SITE = "https://docs.example.org/mcmd"
KINDS = sorted({type(estimator) for estimator in ESTIMATORS.values()}, key=repr)


@pytest.fixture
def site(monkeypatch):
    monkeypatch.setattr(_sklearn, "documentation_site", lambda: SITE)


@pytest.mark.parametrize("kind", KINDS)
def test_an_estimator_links_to_a_page_that_the_api_has(kind, site):
    link = kind()._get_doc_link()
    page = link.removeprefix(f"{SITE}/generated/").removesuffix(".html")
    assert link == f"{SITE}/generated/{page}.html"
    assert page in documented()


def test_the_html_of_a_pipeline_links_to_both_sites(site):
    from sklearn.preprocessing import StandardScaler

    html = estimator_html_repr(make_pipeline(RobustNormalEstimator(), StandardScaler()))
    assert f"{SITE}/generated/sklearn_mcmd.RobustNormalEstimator.html" in html
    assert "sklearn.preprocessing.StandardScaler.html" in html


def test_without_a_site_there_is_no_link(monkeypatch):
    monkeypatch.setattr(_sklearn, "documentation_site", lambda: "")
    assert RegionGrowing()._get_doc_link() == ""
    assert "generated/" not in estimator_html_repr(RegionGrowing())


def test_a_users_subclass_has_no_page_of_ours(site):
    class Mine(RegionGrowing):
        pass

    assert Mine()._get_doc_link() == ""


def test_the_site_is_the_one_that_pyproject_names():
    path = Path(__file__).parents[1] / "pyproject.toml"
    urls = tomllib.loads(path.read_text())["project"]["urls"]
    assert _sklearn.documentation_site() == urls["Documentation"]

"""Links from the HTML form of an estimator to its page of the API."""

import tomllib
from pathlib import Path

import pytest
from sklearn.pipeline import make_pipeline
from sklearn.utils import estimator_html_repr

from public import ESTIMATORS
from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
from test_docs import documented

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
SITE = PROJECT["urls"]["Documentation"]
KINDS = sorted({type(estimator) for estimator in ESTIMATORS.values()}, key=repr)


@pytest.mark.parametrize("kind", KINDS)
def test_an_estimator_links_to_a_page_that_the_api_has(kind):
    link = kind()._get_doc_link()
    page = link.removeprefix(f"{SITE}/generated/").removesuffix(".html")
    assert link == f"{SITE}/generated/{page}.html"
    assert page in documented()


def test_the_html_of_a_pipeline_links_to_both_sites():
    from sklearn.preprocessing import StandardScaler

    html = estimator_html_repr(make_pipeline(RobustNormalEstimator(), StandardScaler()))
    assert f"{SITE}/generated/sklearn_mcmd.RobustNormalEstimator.html" in html
    assert "sklearn.preprocessing.StandardScaler.html" in html


def test_a_users_subclass_has_no_page_of_ours():
    class Mine(RegionGrowing):
        pass

    assert Mine()._get_doc_link() == ""

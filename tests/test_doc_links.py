"""Links from the HTML form of an estimator to its page of the API."""

import inspect
import tomllib
from importlib import import_module
from pathlib import Path

import pytest
from sklearn.base import BaseEstimator
from sklearn.pipeline import make_pipeline
from sklearn.utils import estimator_html_repr

from sklearn_mcmd import RegionGrowing, RobustNormalEstimator, _sklearn
from test_docs import MODULES, documented

ROOT = Path(__file__).parents[1]
SITE = "https://docs.example.org/mcmd"
ESTIMATORS = sorted(
    {
        member
        for name in MODULES
        for member in (getattr(import_module(name), n) for n in import_module(name).__all__)
        if inspect.isclass(member) and issubclass(member, BaseEstimator)
    },
    key=lambda kind: kind.__name__,
)


@pytest.fixture
def site(monkeypatch):
    monkeypatch.setattr(_sklearn, "documentation_site", lambda: SITE)


@pytest.mark.parametrize("kind", ESTIMATORS)
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


def test_the_site_is_the_one_that_pyproject_names():
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["urls"]
    assert _sklearn.documentation_site() == urls.get("Documentation", "").rstrip("/")


def test_the_site_is_read_from_the_metadata_of_the_installed_package(monkeypatch):
    from email.message import Message

    told = Message()
    told["Project-URL"] = "Source, https://example.org/code"
    told["Project-URL"] = "Documentation, https://example.org/docs/"
    monkeypatch.setattr("importlib.metadata.metadata", lambda name: told)
    assert _sklearn.documentation_site.__wrapped__() == "https://example.org/docs"


def test_a_users_subclass_has_no_page_of_ours(site):
    class Mine(RegionGrowing):
        pass

    assert Mine()._get_doc_link() == ""

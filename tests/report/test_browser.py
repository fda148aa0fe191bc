"""Reports in a browser: no error, no request, and nothing wider than a phone."""

import os
import shutil
import socket
from contextlib import suppress

import numpy as np
import pytest

from commands import run
from sklearn_mcmd.io import PointCloud, write_points

playwright = pytest.importorskip("playwright.sync_api")
pytestmark = pytest.mark.slow

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@pytest.fixture(scope="module")
def chromium():
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip("no Chromium is installed")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A floor and a wall with stray points, of a name that is no markup."""
    rng = np.random.default_rng(0)
    floor = rng.uniform(0, 4, (3000, 3)) * [1, 1, 0]
    wall = rng.uniform(0, 4, (3000, 3)) * [1, 0, 1] + [0, 4, 0]
    xyz = np.vstack([floor, wall, rng.uniform(0, 4, (100, 3))]) + rng.normal(0, 0.004, (6100, 3))
    path = tmp_path_factory.mktemp("report") / "a & b.npz"
    write_points(path, PointCloud(np.round(xyz, 4), {"<b>": np.arange(6100)}))
    return path


@pytest.fixture(scope="module", params=["denoise", "normals", "segment", "edges", "plane"])
def page(request, source):
    folder = source.parent / request.param
    result = run(request.param, source, source.parent / "out.npz", "--report", folder)
    assert result.exit_code == 0, result.output
    return folder / "index.html"


@pytest.mark.parametrize("size", [(1400, 900), (390, 844)])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_page_opens_without_error_or_request_and_fits(size, scheme, chromium, page):
    context = chromium.new_context(
        viewport={"width": size[0], "height": size[1]}, color_scheme=scheme
    )
    said, asked = [], []
    tab = context.new_page()
    tab.on("console", lambda message: said.append(message.text))
    tab.on("pageerror", lambda error: said.append(str(error)))
    tab.on("request", lambda request: asked.append(request.url))
    tab.goto(page.as_uri())
    assert said == []
    assert [url for url in asked if not url.startswith("data:")] == [page.as_uri()]
    assert tab.evaluate("document.documentElement.scrollWidth") == size[0]
    images = "[...document.images].every(image => image.complete && image.naturalWidth > 0)"
    assert tab.evaluate(images)
    lightness = "getComputedStyle(document.body).backgroundColor.match(/\\d+/g)[0] > 128"
    assert tab.evaluate(lightness) == (scheme == "light")
    # The bar is as long as its share of the picture says.
    bar, picture = (
        tab.locator(f".map:first-child {part}").first.bounding_box() for part in (".scale", "img")
    )
    assert bar["width"] < 0.21 * picture["width"]
    context.close()


def test_the_link_leads_to_the_other_page(chromium, page):
    tab = chromium.new_page()
    tab.goto(page.as_uri())
    tab.click("text=Look around in the cloud")
    tab.wait_for_url("**/view.html")
    tab.close()


def test_tables_and_pictures_are_printed(chromium, page, tmp_path):
    tab = chromium.new_page()
    tab.goto(page.as_uri())
    tab.emulate_media(media="print")
    assert not tab.is_visible("text=Look around in the cloud")
    tab.pdf(path=tmp_path / "report.pdf")
    assert (tmp_path / "report.pdf").stat().st_size > 10_000
    tab.close()


EVIL = "<script>window.ran = alert(1)</script>"
# What a page must not do even if markup came into it: run scripts, and ask for anything.
SCRIPT = """() => {
    const script = document.createElement("script");
    script.textContent = "window.ran = true";
    document.body.append(script);
    document.body.insertAdjacentHTML("beforeend", "<b onclick='window.ran = true'></b>");
    document.body.lastChild.click();
}"""
ASKING = """(url) => {
    fetch(url).catch(() => {});
    const image = new Image(), form = document.createElement("form");
    image.src = url;
    Object.assign(form, { method: "post", action: url, target: "_blank" });
    document.body.append(image, form);
    form.submit();
}"""


@pytest.fixture(scope="module")
def evil_pages(tmp_path_factory):
    """All pages of a file and an attribute whose names are scripts."""
    folder = tmp_path_factory.mktemp("evil")
    name = EVIL.replace("/", "") + "<img src=x onerror=alert(1)>.npz"
    source = folder / (name if os.name == "posix" else "&lt;.npz")
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 4, (2000, 3)) * [1, 1, 0.002]
    scores = {EVIL: np.arange(2000), "&quot;<!--": np.zeros(2000), "\x00\x1b": np.ones(2000)}
    write_points(source, PointCloud(xyz, scores))
    pages = []
    for verb in ("denoise", "normals", "segment", "edges", "plane"):
        result = run(verb, source, folder / f"{verb}.npz", "--report", folder / verb)
        assert result.exit_code == 0, result.output
        pages += sorted((folder / verb).glob("*.html"))
    options = ("--color", EVIL, "--title", EVIL, "-o", folder / f"<script>{verb}.html")
    result = run("view", source, folder / "denoise.npz", *options)
    assert result.exit_code == 0, result.output
    assert len(pages) == 10
    return source.name, [*pages, options[-1]]


def test_names_that_are_scripts_are_shown_and_run_nowhere(chromium, evil_pages):
    name, pages = evil_pages
    for page in pages:
        said, asked = [], []
        tab = chromium.new_page()
        tab.on("console", lambda told, said=said: told.type == "error" and said.append(told.text))
        for event in ("pageerror", "dialog"):
            tab.on(event, lambda told, said=said: said.append(str(told)))
        tab.on("request", lambda request, asked=asked: asked.append(request.url))
        tab.goto(page.as_uri())
        tab.wait_for_load_state("networkidle")
        assert said == [], page
        assert {url for url in asked if not url.startswith("data:")} == {page.as_uri()}
        assert name in tab.evaluate("document.documentElement.textContent + document.title")
        assert not tab.query_selector("img[src=x]")
        assert tab.evaluate("window.ran") is None
        tab.close()


def test_the_policy_of_pages_lets_nothing_run_or_ask(chromium, evil_pages):
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.5)
        url = "http://{}:{}/x".format(*server.getsockname())
        tab = chromium.new_page()
        for page in evil_pages[1]:
            tab.goto(page.as_uri())
            tab.wait_for_load_state("networkidle")
            tab.evaluate(SCRIPT)
            assert tab.evaluate("window.ran") is None, page
            tab.evaluate(ASKING, url)
            assert sent_to(server) == b"", page
        tab.goto("about:blank")  # which has no policy
        tab.evaluate(SCRIPT)
        assert tab.evaluate("window.ran")
        tab.evaluate(ASKING, url)
        assert b" /x HTTP" in sent_to(server)
        tab.close()


def sent_to(server):
    """What a browser sends over all its connections; of some it makes no use."""
    sent = b""
    while True:
        try:
            connection, _ = server.accept()
        except TimeoutError:
            return sent
        with connection, suppress(TimeoutError):
            connection.settimeout(0.5)
            sent += connection.recv(1000)

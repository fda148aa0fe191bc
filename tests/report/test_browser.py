"""Reports in a browser: no error, no request, no script, and nothing wider than a phone."""

import os
import socket
from contextlib import contextmanager, suppress

import numpy as np
import pytest

from commands import done
from sklearn_mcmd.io import PointCloud, write_points

pytestmark = pytest.mark.slow

VERBS = ("denoise", "normals", "segment", "edges", "plane")
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
def pages(tmp_path_factory):
    """The name of a file that is a script, and all pages of it; an attribute is one, too."""
    folder = tmp_path_factory.mktemp("report")
    name = EVIL.replace("/", "") + "<img src=x onerror=alert(1)>.npz"
    source = folder / (name if os.name == "posix" else "&lt;.npz")
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 4, (3000, 3)) * [1, 1, 0] + rng.normal(0, 0.004, (3000, 3))
    xyz[:50] = rng.uniform(0, 4, (50, 3))
    scores = {EVIL: np.arange(3000), "&quot;<!--": np.zeros(3000), "\x00\x1b": np.ones(3000)}
    write_points(source, PointCloud(np.round(xyz, 4), scores))
    for verb in VERBS:
        done(verb, source, folder / f"{verb}.npz", "--report", folder / verb)
    view = folder / "<script>view.html"
    options = ("--color", EVIL, "--title", EVIL, "-o", view)
    done("view", source, folder / "denoise.npz", *options)
    reports = [folder / verb / "index.html" for verb in VERBS]
    return source.name, reports, [view, *(page.with_name("view.html") for page in reports)]


@contextmanager
def opened(chromium, page, width=1400, scheme="light"):
    """A page that makes no error and no request."""
    context = chromium.new_context(viewport={"width": width, "height": 844}, color_scheme=scheme)
    errors, requests, tab = [], [], context.new_page()
    tab.on("console", lambda line: line.type == "error" and errors.append(line.text))
    for event in ("pageerror", "dialog"):
        tab.on(event, lambda error: errors.append(str(error)))
    tab.on("request", lambda request: requests.append(request.url))
    tab.goto(page.as_uri())
    tab.wait_for_load_state("networkidle")
    yield tab
    assert errors == [], page
    assert {url for url in requests if not url.startswith("data:")} == {page.as_uri()}
    context.close()


@pytest.mark.parametrize(("width", "scheme"), [(1400, "light"), (1400, "dark"), (390, "dark")])
def test_a_report_fits_the_window_and_follows_the_theme(width, scheme, chromium, pages):
    images = "[...document.images].every(image => image.complete && image.naturalWidth > 0)"
    lightness = "getComputedStyle(document.body).backgroundColor.match(/\\d+/g)[0] > 128"
    for page in pages[1]:
        with opened(chromium, page, width, scheme) as tab:
            assert tab.evaluate("document.documentElement.scrollWidth") == width
            assert tab.evaluate(images)
            assert tab.evaluate(lightness) == (scheme == "light")


def test_names_that_are_scripts_are_shown_and_run_nowhere(chromium, pages):
    for page in pages[1] + pages[2]:
        with opened(chromium, page) as tab:
            text = tab.evaluate("document.documentElement.textContent + document.title")
            assert pages[0] in text
            assert not tab.query_selector("img[src=x]")
            assert tab.evaluate("window.ran") is None


def test_the_policy_of_pages_lets_nothing_run_or_ask(chromium, pages):
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.5)
        url = "http://{}:{}/x".format(*server.getsockname())
        tab = chromium.new_page()
        for page in pages[1] + pages[2]:
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

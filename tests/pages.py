"""Pages of clouds read as a browser would, by an independent way, and a page in a browser."""

import json
import re
import time
import zlib
from dataclasses import dataclass, field
from math import gcd

import numpy as np

DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%()*+,-./:;=?@[]^_`{"

STILL = "cloudPage.loaded && !cloudPage.renderer.moving && !cloudPage.renderer.scheduled"


@dataclass
class Cloud:
    """A cloud of a page, its points as the browser draws them."""

    steps: np.ndarray
    rows: np.ndarray
    columns: dict[str, list[np.ndarray]] = field(default_factory=dict)


def read_page(html):
    """What the page is told, and its clouds."""
    manifest = json.loads(re.search(r'id="manifest">(.*?)</script>', html)[1])
    blocks = re.findall(r'<script type="text/plain" class="block">([^<]*)</script>', html)
    return manifest, [read_cloud(told, manifest, blocks) for told in manifest["clouds"]]


def read_cloud(told, manifest, blocks):
    parts = [read_chunk(chunk, blocks) for chunk in told["chunks"]]
    columns = [np.concatenate(values) for values in zip(*parts, strict=True)]
    cloud = Cloud(np.column_stack(columns[:3]), columns[3])
    columns_left = iter(columns[4:])
    for index in told["attributes"]:
        attribute = manifest["attributes"][index]
        n = {"rgb": 3, "normal": 2}.get(attribute["kind"], 1)
        cloud.columns[attribute["name"]] = [next(columns_left) for _ in range(n)]
    assert next(columns_left, None) is None
    assert len(cloud.rows) == told["n"]
    return cloud


def read_chunk(chunk, blocks):
    return [spread(column(blocks[b], chunk["n"], w, d, size)) for w, d, b, size in chunk["columns"]]


def column(text, n, width, delta, size):
    """The numbers of a block, one after the other."""
    data = zlib.decompress(from_base85(text)[:size])
    assert len(data) == n * width
    planes = [data[n * i : n * (i + 1)] for i in range(width)]
    numbers = [int.from_bytes(parts, "little") for parts in zip(*planes, strict=True)]
    if not delta:
        return numbers
    values, last = [], 0
    for number in numbers:
        change = number // 2 if number % 2 == 0 else -(number + 1) // 2
        last = (last + change) % 256**width
        values.append(last)
    return values


def from_base85(text):
    data = bytearray()
    for i in range(0, len(text), 5):
        word = 0
        for character in text[i : i + 5]:
            word = 85 * word + DIGITS.index(character)
        data += word.to_bytes(4, "little")
    return bytes(data)


def spread(values):
    """Values in the order in which the page draws them: leaps of the golden section."""
    n = len(values)
    leap = max(1, int(0.6180339887498949 * n + 0.5))
    while gcd(leap, n) != 1:
        leap += 1
    return np.array(values)[(leap * np.arange(n)) % n]


class Tab:
    """A page in the browser, and all that it said."""

    def __init__(self, browser, path, **options):
        self.context = browser.new_context(viewport={"width": 1000, "height": 700}, **options)
        self.said, self.asked = [], []
        self.tab = self.context.new_page()
        self.tab.on("console", lambda message: self.said.append(message.text))
        self.tab.on("pageerror", lambda error: self.said.append(str(error)))
        self.tab.on("request", lambda request: self.asked.append(request.url))
        self.tab.goto(path.as_uri())
        self.rest()

    def ask(self, expression):
        return self.tab.evaluate(expression)

    def rest(self):
        """Wait until all is drawn."""
        self.wait_for(f"Boolean(window.cloudPage && {STILL})")

    def wait_for(self, expression):
        """The page forbids the evaluation that Playwright's wait needs."""
        end = time.monotonic() + 600
        while not self.ask(expression):
            assert time.monotonic() < end, self.said
            time.sleep(0.05)

    def text(self, selector):
        return self.tab.inner_text(selector)

    def card(self):
        """Names and values of the card."""
        names, values = (self.tab.locator(f"#card > dl > {tag}") for tag in ("dt", "dd"))
        return dict(zip(names.all_inner_texts(), values.all_inner_texts(), strict=True))

    def place(self, row):
        """Where a row of the first cloud is on the screen."""
        return self.ask(
            f"""(() => {{
                const cloud = cloudPage.scene.clouds[0], i = cloud.rows.indexOf({row});
                const at = cloudPage.camera.project(...placeOf({{ cloud, i }}));
                return [at.x, at.y];
            }})()"""
        )

    def picked_row(self):
        hit = "cloudPage.overlay.picked"
        return self.ask(f"{hit} && {hit}.cloud.rows[{hit}.i]")

"""README's two commands stand behind their markers, and its Python prints what it shows."""

import csv
import os
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCRIPT = ROOT / ".ci" / "readme_command"

pytestmark = pytest.mark.skipif(
    not SCRIPT.is_file() or shutil.which("bash") is None or os.name == "nt",
    reason="a checkout and a POSIX shell are needed",
)


@pytest.mark.parametrize(
    ("name", "folder", "job"), [("main", ".venv", "mcmd demo"), ("test", "venv-test", "pytest")]
)
def test_each_command_makes_an_environment_installs_and_does_its_job(name, folder, job):
    told = subprocess.run(["bash", SCRIPT, name], capture_output=True, text=True, timeout=600)
    make, install, work = told.stdout.replace("\\\n", " ").split(" && ")
    assert make == f"python -m venv {folder}"
    assert install.startswith(f"{folder}/bin/pip install ")
    assert work.startswith(f"{folder}/bin/{job}")


def local_file(address):
    """The file of the checkout that an address of the repository or of the pages shows."""
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["urls"]
    raw = urls["Source"].replace("//github.com", "//raw.githubusercontent.com")
    for site in (f"{urls['Source']}/blob/main/", f"{raw}/main/"):
        if address.startswith(site):
            return ROOT / address.removeprefix(site)
    if address.startswith(site := f"{urls['Documentation']}/"):
        return (ROOT / "docs" / address.removeprefix(site)).with_suffix(".rst")
    return None


def test_links_work_on_an_index_page_too_and_lead_to_files_of_the_checkout():
    links = re.findall(r"\]\(([^)]+)\)", (ROOT / "README.md").read_text())
    assert all(link.startswith("https://") for link in links)
    ours = [file for file in map(local_file, links) if file is not None]
    assert [file for file in ours if not file.is_file()] == []
    assert len(ours) > 20


@pytest.mark.parametrize(
    ("page", "words", "shares"),
    [
        ("README.md", r"scanner, ([\d.]+) % are found and ([\d.]+) %", "position found, kept"),
        ("README.md", r"([\d.]+) % of those .* sensor ([\d.]+) %", "mixed_pixel"),
        ("docs/install.rst", r"found +([\d.]+) % .* kept +([\d.]+) %", "position found, kept"),
        ("docs/limits.rst", r"mixed pixels. With the position ([\d.]+) %", "position found"),
        ("docs/limits.rst", r"ghosts and ([\d.]+) % .*? and ([\d.]+) % of the", "mixed_pixel"),
        ("docs/limits.rst", r"labels are ([\d.]+) % and ([\d.]+) %", "right"),
        ("docs/first_scan.rst", r"and ([\d.]+) % of them .* ([\d.]+) % of the m", "mixed_pixel"),
        ("docs/first_scan.rst", r"finds ([\d.]+) % of all outliers", "position found"),
    ],
)
def test_shares_of_the_demo_are_those_of_its_stored_run(page, words, shares):
    with open(ROOT / "docs" / "benchmarks" / "demo.csv", newline="") as file:
        by_coordinates, by_position = csv.DictReader(file)
    if shares.startswith("position "):
        stored = [by_position[name] for name in shares.removeprefix("position ").split(", ")]
    else:
        stored = [by_coordinates[shares], by_position[shares]]
    told = re.search(words, " ".join((ROOT / page).read_text("utf-8").split())).groups()
    for number, share in zip(told, stored, strict=True):
        half = 0.5 / 10 ** len(number.partition(".")[2])
        assert float(number) == pytest.approx(float(share), abs=half + 0.005), page


def test_a_reader_has_the_command_in_60_words_and_all_in_500():
    shown = re.sub(r"<!--.*?-->", "", (ROOT / "README.md").read_text("utf-8"), flags=re.DOTALL)
    assert len(shown.partition("python -m venv")[0].split()) <= 60
    assert len(shown.partition("## More")[0].split()) <= 500


def test_the_lines_of_python_print_what_stands_under_them(capsys):
    readme = (ROOT / "README.md").read_text()
    code, output = re.search(r"```python\n(.*?)```\n\n```\n(.*?)```", readme, re.DOTALL).groups()
    exec(compile(code, "README.md", "exec"), {})
    assert capsys.readouterr().out == output

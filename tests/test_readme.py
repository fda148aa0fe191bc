"""README's two commands stand behind their markers, and its Python prints what it shows."""

import os
import re
import shlex
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


def extract(*args):
    return subprocess.run(["bash", SCRIPT, *args], capture_output=True, text=True, timeout=600)


def steps(name):
    """The words of each command of a chain."""
    chain = extract(name).stdout.replace("\\\n", " ")
    return [shlex.split(step) for step in chain.split("&&")]


@pytest.mark.parametrize(("name", "job"), [("main", ["mcmd", "demo"]), ("test", ["pytest"])])
def test_each_command_makes_an_environment_installs_and_does_its_job(name, job):
    make, install, work = steps(name)
    folder = make[3]
    assert make[:3] == ["python", "-m", "venv"]
    assert install[:2] == [f"{folder}/bin/pip", "install"]
    assert work[: len(job)] == [f"{folder}/bin/{job[0]}", *job[1:]]


def test_the_two_commands_use_environments_of_their_own():
    assert steps("main")[0][3] != steps("test")[0][3]


def test_readme_has_exactly_two_marked_commands():
    markers = re.findall(r"<!-- ci:(\w+) -->", (ROOT / "README.md").read_text())
    assert markers == ["main", "test"]


@pytest.mark.parametrize("text", ["", "<!-- ci:main -->\n", "<!-- ci:main -->\n```sh\n```\n"])
def test_a_missing_command_fails(text, tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text(text)
    done = extract("main", str(readme))
    assert (done.returncode, done.stdout) == (1, "")
    assert "ci:main" in done.stderr


def test_a_command_of_several_lines_is_extracted_word_for_word(tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text("<!-- ci:a -->\n\n```sh\none \\\n  && two\n```\n```sh\nthree\n```\n")
    assert extract("a", str(readme)).stdout == "one \\\n  && two\n"


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


def test_pictures_that_readme_shows_are_there_and_small():
    links = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", (ROOT / "README.md").read_text())
    assert links
    for link in links:
        assert local_file(link).stat().st_size <= 400_000


def test_the_lines_of_python_print_what_stands_under_them(capsys):
    readme = (ROOT / "README.md").read_text()
    code, output = re.search(r"```python\n(.*?)```\n\n```\n(.*?)```", readme, re.DOTALL).groups()
    exec(compile(code, "README.md", "exec"), {})
    assert capsys.readouterr().out == output

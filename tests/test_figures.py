"""benchmarks/figures.py: each stored result has its command, and was measured at a known commit."""

import re
import subprocess
from pathlib import Path

import pytest

from benchmarks.figures import RESULTS, measurements

ROOT = Path(__file__).resolve().parents[1]
GIT = ["git", "-C", str(ROOT)]
TEXT = {"capture_output": True, "text": True}
if not (ROOT / "docs").is_dir():
    pytest.skip("a checkout is needed", allow_module_level=True)


def test_every_commit_that_a_result_names_is_there():
    if subprocess.run([*GIT, "rev-parse", "--is-shallow-repository"], **TEXT).stdout != "false\n":
        pytest.skip("a clone with all commits is needed")
    commits = {row[3] for row in RESULTS if len(row) > 3}
    for pattern, *_ in RESULTS:
        for path in ROOT.glob(pattern):
            commits |= {commit for commit, _ in measurements(path, ROOT)}
    asked = "\n".join(sorted(commits))
    known = subprocess.run([*GIT, "cat-file", "--batch-check"], input=asked, **TEXT).stdout
    assert [line for line in known.splitlines() if " commit " not in line] == []


def test_scripts_that_have_gone_are_in_the_commits_that_pages_and_the_list_name():
    if subprocess.run([*GIT, "rev-parse", "--is-shallow-repository"], **TEXT).stdout != "false\n":
        pytest.skip("a clone with all commits is needed")
    pages = [page.read_text("utf-8") for page in ROOT.glob("docs/*.rst")]
    commands = "\n".join([*pages, *(row[2] for row in RESULTS)])
    named = set(re.findall(r"([\w/]+\.py)`*\s(?:at|of)\s`*([0-9a-f]{7,40})\b", commands))
    assert named
    asked = "\n".join(f"{commit}:benchmarks/{script}" for script, commit in sorted(named))
    known = subprocess.run([*GIT, "cat-file", "--batch-check"], input=asked, **TEXT).stdout
    assert [line for line in known.splitlines() if " blob " not in line] == []


def test_every_picture_has_a_command_and_every_page_of_evidence_its_commits():
    found = [set(ROOT.glob(pattern)) for pattern, *_ in RESULTS]
    assert all(found)
    known = set.union(*found)
    pages = {*ROOT.glob("docs/*.rst"), ROOT / "README.md"}
    assert {page for page in pages if measurements(page, ROOT)} <= known
    assert set((ROOT / "docs/images").rglob("*.*")) <= known
    for path in known:
        if path.suffix in (".rst", ".md"):
            assert measurements(path, ROOT), path
    folders = {part for _, parts, *_ in RESULTS for part in parts.split()}
    assert all((ROOT / "sklearn_mcmd" / part).is_dir() for part in folders)


def test_what_has_to_pass_has_the_check():
    assert "python benchmarks/figures.py --check" in (ROOT / ".ci" / "run").read_text()

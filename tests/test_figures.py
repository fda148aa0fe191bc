"""benchmarks/figures.py: each stored result has its command, and was measured at a known commit."""

import subprocess
from pathlib import Path

import pytest

from benchmarks.figures import RESULTS, measurements

ROOT = Path(__file__).resolve().parents[1]
TEXT = {"capture_output": True, "text": True}
if not (ROOT / "docs").is_dir():
    pytest.skip("a checkout is needed", allow_module_level=True)


def test_every_commit_that_a_result_names_is_there():
    git = ["git", "-C", str(ROOT), "rev-parse", "--is-shallow-repository"]
    if subprocess.run(git, **TEXT).stdout != "false\n":
        pytest.skip("a clone with all commits is needed")
    commits = {row[3] for row in RESULTS if len(row) > 3}
    for pattern, *_ in RESULTS:
        for path in ROOT.glob(pattern):
            commits |= {commit for commit, _ in measurements(path, ROOT)}
    asked = "\n".join(sorted(commits))
    known = subprocess.run([*git[:3], "cat-file", "--batch-check"], input=asked, **TEXT).stdout
    assert [line for line in known.splitlines() if " commit " not in line] == []


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

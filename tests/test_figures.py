"""benchmarks/figures.py: which stored results are older than the code that they measure."""

import subprocess
from pathlib import Path

import pytest

from benchmarks.figures import RESULTS, main, measurements

ROOT = Path(__file__).resolve().parents[1]


def commit(root, **files):
    """Write files and commit them; the commit's short name."""
    for name, text in files.items():
        path = root / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    identity = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"]
    for arguments in (["add", "."], [*identity, "commit", "-qm", "a"]):
        subprocess.run(["git", "-C", str(root), *arguments], check=True)
    told = ["git", "-C", str(root), "rev-parse", "--short=7", "HEAD"]
    return subprocess.run(told, check=True, capture_output=True, text=True).stdout.strip()


def test_results_are_as_old_as_the_commits_to_what_they_measure(tmp_path, capsys):
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    code = commit(tmp_path, sklearn_mcmd__planes__a="1", sklearn_mcmd__edges__a="1")
    picture = commit(tmp_path, picture="1")
    later = commit(tmp_path, sklearn_mcmd__planes__a="2")
    commit(tmp_path, sklearn_mcmd__edges__a="2")
    page = f"Measured at ``{code}`` (the\nold) and\n``{later}``\n(new).\n\nNot ``{picture}``.\n"
    commit(tmp_path, **{"page.rst": page, "lost.rst": "Measured at ``0123abc``.\n\n"})
    results = (
        ("pict*", "planes", ""),
        ("page.rst", "planes edges", ""),
        ("pict*", "planes", "", later),
    )
    assert main(["--check"], tmp_path, results) == 0
    rows = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()[1:]]
    assert rows == [
        f"picture {picture} 1 in planes",
        f"page.rst (the old) {code} 2 in planes edges",
        f"page.rst (new) {later} 1 in planes edges",
        f"picture {later}",
    ]
    assert main(["--check"], tmp_path, [("lost.rst", "planes", "")]) == 1
    assert "no such commit" in capsys.readouterr().out


@pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="a checkout is needed")
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

"""What tools read beside the code: the marker of type hints and the citation."""

import re
import tomllib
from importlib.resources import files
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def test_type_checkers_are_told_to_read_the_hints():
    assert (files("sklearn_mcmd") / "py.typed").is_file()


def test_the_citation_and_the_package_name_the_same_repository():
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["urls"]
    cited = re.search(r"^repository-code: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.M)
    assert cited[1] == urls["Source"]

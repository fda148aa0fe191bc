"""Say which stored results are older than the code that they measure.

    python benchmarks/figures.py            # the command that renews each
    python benchmarks/figures.py --check    # and how often the code has changed since

A picture or file was measured at the last commit that wrote it. A page has a paragraph such as
"Measured at ``0123abc`` (scenes) and ``4567def`` (real clouds)": write there the commit whose code
you have run. A study that is done stays in its commit; the page then names the script there.

The check fails where a commit is not in the history. Age alone is no failure: most changes leave
results as they are, and who releases reads the list.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OUTLIERS, NORMALS = "planes outliers datasets", "planes normals datasets"
STAGES = "planes outliers normals segmentation edges datasets"
# Scripts that have answered, and the commit that holds them.
RINGS, MUTANTS = "rings_figure.py at 97bb9769", "mutate.py at 97bb9769"
# What is stored, the folders of sklearn_mcmd that it measures, and the scripts of benchmarks/ that
# renew it. Last the commit after which all were renewed, of which some came out as before.
RESULTS = (
    ("docs/benchmarks/peers.json", STAGES, "bench_peers.py"),
    ("docs/images/demo.png", f"{NORMALS} outliers", "mcmd demo, demo_figures.py"),
    ("docs/benchmarks/demo.csv", f"{NORMALS} outliers", "mcmd demo, demo_figures.py"),
    ("docs/images/failure_*", STAGES, f"docs/figures_failure.py, {RINGS}", "900703c"),
    ("docs/images/guide/*", f"{STAGES} adjustment plotting view", "docs/figures.py", "900703c"),
    ("docs/benchmarks.rst", STAGES, "bench_peers.py"),
    ("docs/benchmarks/change_*", f"{NORMALS} change", "bench_change.py --output docs/benchmarks"),
    ("docs/_static/preview.jpg", f"{NORMALS} outliers plotting", "docs/figures.py"),
    ("docs/benchmarks/public_*.csv", STAGES, "bench_public.py --output docs/benchmarks"),
    ("README.md", OUTLIERS, "bench_real.py, readme_figures.py"),
    ("docs/benchmarks.rst", STAGES, "bench_peers.py, bench_public.py"),
    ("docs/constants.rst", STAGES, "ablation.py at 0f835d4c"),
    ("docs/edges.rst", f"{NORMALS} outliers edges", "bench_edges.py, also at 0bdc31fa"),
    ("docs/benchmarks/edges_panel.csv", f"{NORMALS} outliers edges", "bench_edges.py --output"),
    ("docs/benchmarks/panel.csv", OUTLIERS, "bench_real.py --panel --output docs/benchmarks"),
    ("docs/limits.rst", OUTLIERS, "readme_figures.py, bench_quantity.py at c7f1ef3"),
    ("docs/normals.rst", NORMALS, "bench_normals.py, bench_errors.py at f4a94cc"),
    ("docs/outliers.rst", OUTLIERS, "bench_real.py, bench_outliers.py at 0f835d4c"),
    ("docs/planes.rst", "adjustment", "bench_planes.py, bench_reliability.py at c7f1ef3"),
    ("docs/promises.rst", STAGES, f"fuzz_files.py, kill_runs.py, golden_results.py, {MUTANTS}"),
    (
        "docs/reproduction.rst",
        f"{STAGES} baselines",
        "-m benchmarks.paper, paper/_segments.py at 0f835d4c",
    ),
    ("docs/segmentation.rst", f"{NORMALS} outliers segmentation", "bench_segmentation.py"),
    ("docs/sensor.rst", OUTLIERS, "bench_sensor.py at 0bdc31fa"),
    ("docs/benchmarks/seams.csv", f"{STAGES} tiling", "bench_seams.py --output docs/benchmarks"),
    ("docs/tiling.rst", "planes tiling", "bench_tiling.py, bench_seams.py"),
    ("docs/user_guide.rst", OUTLIERS, "bench_seeds.py at 0bdc31fa"),
    ("docs/view.rst", "view", "bench_view.py at 7f76556"),
)


def main(arguments=None, root=ROOT, results=RESULTS):
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="say how old each result is")
    if not parser.parse_args(arguments).check:
        for pattern, _, command, *_ in results:
            print(f"{pattern:<32}  {command}")
        return 0
    if git(root, "rev-parse", "--is-shallow-repository").strip() == "true":
        print("not checked: this clone has not all commits; git fetch --unshallow brings them")
        return 0
    print(f"{'result':<56}  measured at  changed since: commits in folders")
    lost = False
    for pattern, parts, _, *renewed in results:
        folders = [f"sklearn_mcmd/{part}" for part in parts.split()]
        for path in sorted(root.glob(pattern)):
            for written, label in measurements(path, root):
                ages = {
                    commit: commits_since(commit, folders, root) for commit in (written, *renewed)
                }
                commit = written if None in ages.values() else min(ages, key=ages.get)
                n = ages[commit]
                lost |= n is None
                since = "no such commit" if n is None else f"{n} in {parts}" if n else ""
                name = path.relative_to(root).as_posix() + (f" ({label})" if label else "")
                print(f"{name:<56}  {commit[:7]:<11}  {since}".rstrip())
    return int(lost)


def measurements(path, root):
    """The commits at which a stored result was measured, each with the part of the page."""
    if path.suffix not in (".rst", ".md"):
        return [(git(root, "log", "-1", "--format=%h", "--", str(path)).strip() or "none", "")]
    told = re.findall(r"^Measured at (.+?)\n\n", path.read_text("utf-8"), re.M | re.S)
    return re.findall(r"`([0-9a-f]{7,40})`+(?: \(([^)]+)\))?", " ".join(" ".join(told).split()))


def commits_since(commit, folders, root):
    """The number of commits that changed the folders after that one; None if it is unknown."""
    try:
        count = git(root, "rev-list", "--count", "--no-merges", f"{commit}..HEAD", "--", *folders)
    except subprocess.CalledProcessError:
        return None
    return int(count)


def git(root, *arguments):
    command = ["git", "-C", str(root), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


if __name__ == "__main__":
    sys.exit(main())

"""Settings in a file: they count as if they were typed, and `mcmd config` prints them all."""

import tomllib

import numpy as np
import pytest

from commands import done, run, usage_error


@pytest.fixture
def settings(tmp_path):
    """Write a file of settings and return its name."""

    def write(text):
        (tmp_path / "settings.toml").write_text(text)
        return tmp_path / "settings.toml"

    return write


@pytest.fixture
def cloud_file(tmp_path):
    rng = np.random.default_rng(0)
    X = rng.uniform(0, 2, (500, 3)) * [1, 1, 0] + rng.normal(0, 0.003, (500, 3))
    np.save(tmp_path / "in.npy", np.vstack([X, rng.uniform(0.3, 1.7, (20, 3))]))
    return tmp_path / "in.npy"


def outliers(cloud_file, *options):
    target = cloud_file.with_name("out.npy")
    done("denoise", cloud_file, target, *options)
    return np.load(target)["outlier"]


def test_settings_of_a_file_count_as_if_they_were_typed(settings, cloud_file):
    path = settings(
        '[denoise]\nmode = "mark"\nstrictness = "paper"\nn_neighbors = 20\nintensity = false\n'
        "[plane]\nalpha = 0.01\n"
    )
    found = outliers(cloud_file, "--config", path)
    typed = ("--mode", "mark", "--strictness", "paper", "--n-neighbors", 20)
    np.testing.assert_array_equal(found, outliers(cloud_file, *typed))
    # What is typed counts more.
    strict = outliers(cloud_file, "--config", path, "--strictness", "surfaces")
    assert (strict != found).any()


def test_the_defaults_that_are_printed_are_a_file_that_changes_nothing(settings, cloud_file):
    printed = run("config").stdout
    tables = tomllib.loads(printed)
    assert {"denoise", "normals", "segment", "edges", "plane", "plan", "view"} == set(tables)
    assert tomllib.loads(run("config", "denoise").stdout) == {"denoise": tables["denoise"]}
    found = outliers(cloud_file, "--mode", "mark", "--config", settings(printed))
    np.testing.assert_array_equal(found, outliers(cloud_file, "--mode", "mark"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[denoise]\ncutof = 3", "denoise has no setting cutof; mcmd config denoise lists all"),
        ("cutoff = 3", "cutoff must stand below a verb, such as [denoise]"),
        ("[cutoff]", "no settings are of [cutoff], but of denoise, normals"),
        ("[denoise]\ncutoff = three", "cannot be read: Invalid value (at line 2"),
        ("[denoise]\ncolumns = " + "[" * 3_000, "cannot be read: maximum recursion depth"),
        ("[denoise]\ncutoff = -3", "denoise.cutoff: -3.0 is not a number above 0"),
        ("[denoise]\nignore_class = [6, 300]", "denoise.ignore_class: 6,300"),
        ('[denoise]\nrestart = "yes"', "denoise has no setting restart"),
    ],
)
def test_a_file_that_cannot_be_meant_is_refused_with_the_setting(text, words, settings, cloud_file):
    result = run("denoise", cloud_file, cloud_file.with_name("out.npy"), "--config", settings(text))
    assert words in usage_error(result)
    assert not cloud_file.with_name("out.npy").exists()

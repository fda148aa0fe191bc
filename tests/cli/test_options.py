"""Options that several verbs share: wrong values are wrong usage, threads change nothing."""

import pytest

from commands import files_in, run


@pytest.mark.parametrize("value", ["local", "-0.01", "0", "nan", "inf"])
def test_a_noise_scale_that_is_no_positive_number_is_wrong_usage(value, room_file, tmp_path):
    result = run("denoise", room_file, tmp_path / "out.laz", "--noise-scale", value)
    assert result.exit_code == 2
    assert "--noise-scale" in result.stderr
    assert files_in(tmp_path) == ["room.laz"]


@pytest.mark.parametrize(
    "option",
    [("--n-neighbors", 3), ("--outlier-rate", 1), ("--mode", "x"), ("--strictness", "none")],
)
def test_options_out_of_range_are_wrong_usage(option, room_file, tmp_path):
    result = run("denoise", room_file, tmp_path / "out.laz", *option)
    assert result.exit_code == 2
    assert option[0] in result.stderr
    assert files_in(tmp_path) == ["room.laz"]


@pytest.mark.parametrize("option", ["--radius", "--cutoff"])
@pytest.mark.parametrize("value", ["0", "-1", "nan"])
def test_numbers_that_must_be_positive_are_wrong_usage(tmp_path, option, value):
    result = run("normals", tmp_path / "in.xyz", tmp_path / "out.xyz", option, value)
    assert result.exit_code == 2
    assert option in result.stderr


def test_zero_threads_are_wrong_usage(tmp_path):
    result = run("denoise", tmp_path / "in.xyz", tmp_path / "out.xyz", "--n-jobs", "0")
    assert result.exit_code == 2


@pytest.mark.parametrize("verb", ["denoise", "normals"])
def test_the_same_seed_gives_the_same_bytes_on_any_number_of_threads(verb, room_file, tmp_path):
    for name, n_jobs in (("a", 1), ("b", 2)):
        run(verb, room_file, tmp_path / f"{name}.csv", "--n-jobs", n_jobs)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()

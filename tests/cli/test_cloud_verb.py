"""Verbs of clouds are records: what all take is set once, and options reach their estimators."""

from dataclasses import fields

import pytest
from typer.main import get_command

from sklearn_mcmd.cli import app
from sklearn_mcmd.cli._cloud_verb import BY_TILES, CloudVerb
from sklearn_mcmd.cli._denoise import Denoise
from sklearn_mcmd.cli._edges import Edges
from sklearn_mcmd.cli._normals import Normals
from sklearn_mcmd.cli._segment import Segment

# Options that are no parameters of the estimator, but say what else to do.
NO_PARAMETERS = {
    Denoise: {"mode", "ignore_class", "only_class", "above", "below", "low_groups", "sensor",
              "trajectory", "intensity"},
    Edges: {"denoise", "colors"},
    Normals: {"sensor", "trajectory"},
    Segment: {"growth_neighbors", "colors", "regions"},
}  # fmt: skip


@pytest.mark.parametrize("kind", NO_PARAMETERS)
def test_every_option_is_a_parameter_of_the_estimator_or_known_not_to_be(kind, tmp_path):
    verb = kind(tmp_path / "in.xyz", tmp_path / "out.xyz")
    own = {field.name for field in fields(kind)} - {field.name for field in fields(CloudVerb)}
    parameters = verb.estimator().get_params(deep=False).keys()
    nested = {"max_outlier_rate"} if kind is Segment else set()  # of its estimator of normals
    assert own - parameters - nested == NO_PARAMETERS[kind]


def test_options_reach_the_estimator_within_another_and_keep_their_own_sizes(tmp_path):
    options = {"n_neighbors": 33, "growth_neighbors": 22, "max_outlier_rate": 0.25, "n_jobs": 3}
    made = Segment(tmp_path / "in.xyz", tmp_path / "out.xyz", **options).estimator()
    assert (made.n_neighbors, made.n_jobs) == (22, 3)
    normals = made.normal_estimator
    assert (normals.n_neighbors, normals.max_outlier_rate, normals.n_jobs) == (33, 0.25, 3)


@pytest.mark.parametrize("kind", NO_PARAMETERS)
def test_the_command_takes_files_first_and_what_all_take_last(kind):
    command = get_command(app).commands[kind.__name__.lower()]
    names = [option.name for option in command.params if option.name != "help"]
    shared = [field.name for field in fields(CloudVerb)]
    if kind is Edges:  # it has no lengths
        shared.remove("unit")
    assert names[:2] == shared[:2] == ["source", "target"]
    assert names[2 - len(shared) :] == shared[2:]
    assert len(names) == len(set(names))
    assert command.help.endswith(BY_TILES.strip())

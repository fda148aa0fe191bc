"""Progress: what estimators tell whoever listens, of the whole of their work."""

from itertools import pairwise

import numba
import numpy as np
import pytest
from numba.core import event

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.runtime import _progress
from sklearn_mcmd.runtime._progress import (
    COMPILING,
    current_span,
    listen_to_progress,
    progress_part,
    watch_compilation,
)


def heard(work):
    """Stages and shares that a listener hears."""
    return [(told.stage, told.share) for told in all_told(work)]


def all_told(work):
    told = []
    with listen_to_progress(told.append):
        work()
    return told


def test_parts_of_parts_are_shares_of_the_whole():
    def work():
        with progress_part(0.0, 0.5, "first"):
            current_span().tell(0.5)
        with progress_part(0.5, 1.0, "second"), progress_part(0.0, 0.2):
            pass

    assert heard(work) == [
        *[("first", share) for share in (0.0, 0.25, 0.5)],
        *[("second", share) for share in (0.5, 0.5, 0.6, 1.0)],
    ]


def test_a_stage_is_told_from_its_begin_to_its_end_whatever_its_share_of_the_whole():
    def work():
        with progress_part(0.5, 0.75, "stage"):
            with progress_part(0.0, 0.5):
                current_span().tell(0.5)
            with progress_part(0.5, 1.0):
                current_span().tell(0.5)

    told = all_told(work)
    assert [t.part for t in told] == [0, 0, 0.25, 0.5, 0.5, 0.75, 1, 1]
    assert {t.stage for t in told} == {"stage"}


def test_nobody_listening_is_no_error():
    with progress_part(0.0, 1.0, "alone"):
        assert current_span() is None


def test_a_listener_of_none_hears_nothing_of_what_is_within():
    def work():
        with listen_to_progress(None), progress_part(0.0, 1.0, "hidden"):
            pass

    assert heard(work) == []


@pytest.mark.parametrize(
    ("estimator", "stages"),
    [
        (MCMDOutlierDetector(random_state=0), ["planes", "outliers"]),
        (RobustNormalEstimator(random_state=0), ["normals", "normals next to edges"]),
        (RobustNormalEstimator(method="pca"), ["normals"]),
        (RegionGrowing(random_state=0), ["normals", "links of neighbors", "narrow faces"]),
        (SharpFeatureDetector(random_state=0), ["planes", "outliers", "normals", "creases"]),
    ],
)
def test_estimators_name_their_stages_in_order_and_tell_the_whole(estimator, stages, room):
    told = heard(lambda: estimator.fit(room.xyz))
    names = list(dict.fromkeys(stage for stage, _ in told))
    assert [name for name in names if name in stages] == stages
    shares = [share for _, share in told if share is not None]  # None while compiling
    assert min(shares) == 0
    assert max(shares) == pytest.approx(1)


def test_the_cutoff_and_the_verdict_of_the_detector_divide_the_whole_without_gaps(room):
    detector = MCMDOutlierDetector(false_positive_rate=0.05, random_state=0)
    ends = {}
    told = heard(lambda: detector.fit(room.xyz))
    for stage, share in told:
        if share is None:  # while compiling
            continue
        first, last = ends.get(stage, (share, share))
        ends[stage] = min(first, share), max(last, share)
    ends.pop("")  # the parts that hold stages
    stages = ["cutoff by simulation", "planes", "outliers"]
    assert list(ends) == stages == list(detector._stages())
    assert min(begin for begin, _ in ends.values()) == 0
    for (_, end), (begin, _) in pairwise(ends.values()):
        assert end == pytest.approx(begin)
    assert max(end for _, end in ends.values()) == pytest.approx(1)


def test_compilation_is_told_and_its_end():
    watch_compilation()

    @numba.njit
    def twice(x):
        return 2 * x

    told = heard(lambda: twice(np.float32(1)))
    assert told[0] == (COMPILING, None)
    assert told[-1] == (None, None)
    assert heard(lambda: twice(np.float32(1))) == []


@pytest.fixture
def own_compilation(monkeypatch):
    """A watcher of its own, and what compiles a function as if it were one of the package."""
    registered = event._registered["numba:compile"]
    others = list(registered)
    registered.clear()
    monkeypatch.setattr(_progress, "PATIENCE", 0.0)
    watch_compilation.__wrapped__()

    def compile_one(module="sklearn_mcmd.planes._explaining_numba"):
        def twice(x):
            return 2 * x

        twice.__module__ = module
        numba.njit(twice)(1)

    yield compile_one
    registered[:] = others


def test_one_line_tells_whoever_waits_at_a_terminal(own_compilation, monkeypatch, capsys):
    own_compilation("mine")
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    own_compilation("mine")
    assert capsys.readouterr().err == ""
    own_compilation()
    own_compilation()
    assert capsys.readouterr().err == f"sklearn_mcmd: {COMPILING}\n"


@pytest.mark.parametrize("listener", [None, lambda told: None])
def test_no_line_where_a_program_shows_progress_or_nobody_waits(
    own_compilation, listener, monkeypatch, capsys
):
    own_compilation()  # the output of tests is no terminal
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with listen_to_progress(listener):
        own_compilation()
    assert capsys.readouterr().err == ""


def test_the_line_goes_to_the_log_where_there_is_one(own_compilation, monkeypatch, caplog, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with caplog.at_level("INFO", logger="sklearn_mcmd"):
        own_compilation()
    assert [record.getMessage() for record in caplog.records] == [f"sklearn_mcmd: {COMPILING}"]
    assert capsys.readouterr().err == ""


def test_the_line_can_be_silenced(own_compilation, monkeypatch, caplog, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with caplog.at_level("WARNING", logger="sklearn_mcmd"):
        own_compilation()
    assert not caplog.records
    assert capsys.readouterr().err == ""

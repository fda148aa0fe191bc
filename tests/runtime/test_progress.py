"""Progress: what estimators tell whoever listens, of the whole of their work."""

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
from sklearn_mcmd.runtime._progress import (
    COMPILING,
    current_span,
    listen_to_progress,
    progress_part,
    watch_compilation,
)


def heard(work):
    """Stages and shares that a listener hears."""
    told = []
    with listen_to_progress(told.append):
        work()
    return [(one.stage, one.share) for one in told]


def test_parts_of_parts_are_shares_of_the_whole():
    def work():
        with progress_part(0.0, 0.5, "first"):
            current_span().report(0.5)
        with progress_part(0.5, 1.0, "second"), progress_part(0.0, 0.2):
            pass

    assert heard(work) == [
        *[("first", share) for share in (0.0, 0.25, 0.5)],
        *[("second", share) for share in (0.5, 0.5, 0.6, 1.0)],
    ]


@pytest.mark.parametrize(
    ("estimator", "stages"),
    [
        (
            MCMDOutlierDetector(false_positive_rate=0.05, random_state=0),
            ["cutoff by simulation", "planes", "outliers"],
        ),
        (
            RobustNormalEstimator("auto", features="all", random_state=0),
            ["sizes of neighborhoods", "normals", "normals next to edges", "curvatures"],
        ),
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


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
@pytest.mark.parametrize("n_jobs", [1, 2])
def test_a_listener_that_raises_ends_the_fit_and_leaves_nothing(n_jobs, error, room):
    def stop(progress):
        if progress.stage == "outliers":
            raise error("stop")

    detector = MCMDOutlierDetector(random_state=0, n_jobs=n_jobs)
    with pytest.raises(error, match="stop"), listen_to_progress(stop):
        detector.fit(room.xyz)
    assert current_span() is None
    assert heard(lambda: detector.fit(room.xyz))[-1][1] == pytest.approx(1)


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
def own_compilation():
    """A watcher of its own, and what compiles a function as if it were one of the package."""
    registered = event._registered["numba:compile"]
    others = list(registered)
    registered.clear()
    watch_compilation.__wrapped__()

    def compile_one(module):
        def twice(x):
            return 2 * x

        twice.__module__ = module
        numba.njit(twice)(1)

    yield compile_one
    registered[:] = others


LINE = f"sklearn_mcmd: {COMPILING}"


@pytest.mark.parametrize(
    ("module", "level", "terminal", "printed", "logged"),
    [
        ("sklearn_mcmd.planes", "NOTSET", True, [LINE], []),
        ("sklearn_mcmd.planes", "NOTSET", False, [], []),  # nobody waits
        ("sklearn_mcmd.planes", "INFO", True, [], [LINE]),
        ("sklearn_mcmd.planes", "WARNING", True, [], []),  # silenced
        ("mine", "NOTSET", True, [], []),
    ],
)
def test_one_line_tells_of_compilation_whoever_waits(
    module, level, terminal, printed, logged, own_compilation, monkeypatch, caplog, capsys
):
    monkeypatch.setattr("sys.stderr.isatty", lambda: terminal)
    with caplog.at_level(level, logger="sklearn_mcmd"):
        own_compilation(module)
        own_compilation(module)
    assert capsys.readouterr().err.splitlines() == printed
    assert [record.getMessage() for record in caplog.records] == logged


@pytest.mark.parametrize("listener", [None, lambda progress: None])
def test_no_line_where_a_program_shows_progress(listener, own_compilation, monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with listen_to_progress(listener):
        own_compilation("sklearn_mcmd.planes")
    assert capsys.readouterr().err == ""

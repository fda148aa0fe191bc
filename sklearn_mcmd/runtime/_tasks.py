"""Callbacks of scikit-learn: the stages of a fit are tasks, and their parts the tasks' own.

Without callbacks, and with scikit-learn before 1.9, none of this does anything.
"""

from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from functools import wraps

from sklearn_mcmd.runtime._progress import current_span, heard_by, progress_part

PARTS = 50  # of a stage, which a bar shows in steps of 2 %

_tasks = ContextVar("sklearn_mcmd_tasks", default=None)


def fit_in_tasks(fit):
    """Decorate a `fit` whose stages are reported to callbacks.

    The estimator has `_stages`, the names of its stages, at least of those that come. Use it below
    ``fit_context``, which ends callbacks whatever happens.
    """

    @wraps(fit)
    def fit_and_report(self, X, y=None, *args, **params):
        if not (getattr(self, "_skl_callbacks", ()) or hasattr(self, "_parent_callback_ctx")):
            token = _tasks.set(None)
            try:
                return fit(self, X, y, *args, **params)
            finally:
                _tasks.reset(token)
        context = self._init_callback_context(max_subtasks=len(self._stages()))
        context.call_on_fit_task_begin(estimator=self, X=X, y=y)
        tasks = _FitTasks(self, context, outer=current_span())
        token = _tasks.set(tasks)
        try:
            with heard_by(tasks.hear):
                result = fit(self, X, y, *args, **params)
        finally:
            _tasks.reset(token)
        tasks.end_stage()
        # Nothing is missing in the estimator: callbacks may use a copy of it as it is.
        context.call_on_fit_task_end(estimator=self, X=X, y=y, reconstruction_attributes=dict)
        return result

    return fit_and_report


@contextmanager
def sub_fit(low, high, name, estimator):
    """Count the fit of an estimator within another as this part of it, and as one of its tasks."""
    tasks = _tasks.get()
    if tasks is None:
        with progress_part(low, high):
            yield
        return
    tasks.end_stage()
    context = tasks.context.subcontext(task_name=name)
    # Stages of the estimator are not the outer one's: only who listens otherwise hears of them.
    with (
        heard_by(tasks.report_outer),
        progress_part(low, high),
        context.propagate_callback_context(estimator),
    ):
        context.call_on_fit_task_begin(estimator=tasks.estimator)
        yield
        context.call_on_fit_task_end(estimator=tasks.estimator)


class _FitTasks:
    """The tasks of one fit, begun and ended as its stages are heard of.

    The context is that of the whole fit. `outer` is the `Span` of who else listens, or None.
    """

    def __init__(self, estimator, context, outer):
        self.estimator, self.context, self.outer = estimator, context, outer
        self.stage, self.task, self.n_done = "", None, 0

    def hear(self, progress):
        """Hear of progress; one thread at a time calls it."""
        if not progress.stage:  # between stages
            self.report_outer(progress)
            return
        if progress.stage != self.stage:
            self.end_stage()
            self.stage, self.n_done = progress.stage, 0
            self.task = self.context.subcontext(task_name=progress.stage, max_subtasks=PARTS)
            self.task.call_on_fit_task_begin(estimator=self.estimator)
        while self.n_done < int(PARTS * progress.part + 1e-9):
            self.n_done += 1
            part = self.task.subcontext(task_name="part")
            part.call_on_fit_task_begin(estimator=self.estimator)
            part.call_on_fit_task_end(estimator=self.estimator)
        self.report_outer(progress)

    def end_stage(self):
        if self.task is not None:
            task, self.task, self.stage = self.task, None, ""
            task.call_on_fit_task_end(estimator=self.estimator)

    def report_outer(self, progress):
        if self.outer is not None:
            replace(self.outer, stage=progress.stage or self.outer.stage).report(progress.share)

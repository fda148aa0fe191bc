"""Callbacks of scikit-learn: the stages of a fit are tasks, and their parts the tasks' own.

Without callbacks, and with scikit-learn before 1.9, none of this does anything.
"""

from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps

from sklearn_mcmd.runtime._progress import current_span, progress_part, told_to

__all__ = ["PARTS", "fit_in_tasks", "sub_fit"]

PARTS = 50  # of a stage, which a bar shows in steps of 2 %

_tasks = ContextVar("sklearn_mcmd_tasks", default=None)


def fit_in_tasks(fit):
    """Decorate a `fit` whose stages are told to callbacks.

    The estimator has `_stages`, the names of its stages, at least of those that come. Use it below
    ``fit_context``, which ends callbacks whatever happens.
    """

    @wraps(fit)
    def fit_and_tell(self, X, y=None, *args, **params):
        if not _is_watched(self):
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
            with told_to(tasks.hear):
                result = fit(self, X, y, *args, **params)
        finally:
            _tasks.reset(token)
        tasks.end_stage()
        # Nothing is missing in the estimator: callbacks may use a copy of it as it is.
        context.call_on_fit_task_end(estimator=self, X=X, y=y, reconstruction_attributes=dict)
        return result

    return fit_and_tell


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
        told_to(tasks.tell_outer),
        progress_part(low, high),
        context.propagate_callback_context(estimator),
    ):
        context.call_on_fit_task_begin(estimator=tasks.estimator)
        yield
        context.call_on_fit_task_end(estimator=tasks.estimator)


class _FitTasks:
    """The tasks of one fit, begun and ended as its stages are heard of.

    The context is that of the whole fit. `outer` is the `Span` of who else is told, or None.
    """

    def __init__(self, estimator, context, outer):
        self.estimator, self.context, self.outer = estimator, context, outer
        self.stage, self.task, self.n_done = "", None, 0

    def hear(self, told):
        """Hear of progress; one thread at a time calls it."""
        if not told.stage:  # between stages
            self.tell_outer(told)
            return
        if told.stage != self.stage:
            self.end_stage()
            self.stage, self.n_done = told.stage, 0
            self.task = self.context.subcontext(task_name=told.stage, max_subtasks=PARTS)
            self.task.call_on_fit_task_begin(estimator=self.estimator)
        while self.n_done < int(PARTS * told.part + 1e-9):
            self.n_done += 1
            part = self.task.subcontext(task_name="part")
            part.call_on_fit_task_begin(estimator=self.estimator)
            part.call_on_fit_task_end(estimator=self.estimator)
        self.tell_outer(told)

    def end_stage(self):
        if self.task is not None:
            task, self.task, self.stage = self.task, None, ""
            task.call_on_fit_task_end(estimator=self.estimator)

    def tell_outer(self, told):
        if self.outer is not None:
            self.outer.in_stage(told.stage).tell(told.share)


def _is_watched(estimator):
    return bool(getattr(estimator, "_skl_callbacks", ())) or hasattr(
        estimator, "_parent_callback_ctx"
    )

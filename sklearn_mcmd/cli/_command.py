"""Verbs are records: their fields become options, and the run ends in clear words."""

from dataclasses import MISSING, fields
from inspect import Parameter, Signature, getdoc
from typing import Annotated

from typer.core import TyperCommand

from sklearn_mcmd.cli._messages import clear_exits

TYPED = f"{__name__}.typed"


class TypedCommand(TyperCommand):
    """A command that remembers what was typed after its name."""

    def parse_args(self, ctx, args):
        ctx.meta[TYPED] = list(args)
        return super().parse_args(ctx, args)


def command_of(kind, *, without=(), more=""):
    """The function that Typer takes: its options are the fields of a record, some left out.

    Files come first, and what the record inherits comes last. Its docstring and `more` are the
    help, and its `run` does the work.
    """
    shared = {one.name for base in kind.__mro__[1:-1] for one in fields(base)}
    taken = [one for one in fields(kind) if one.name not in without]
    taken.sort(key=lambda one: (one.name not in ("source", "target"), one.name in shared))
    parameters = []
    for one in taken:
        hint = one.type
        if one.metadata:
            option = one.metadata["option"]
            option.metavar = option.metavar or _metavar(hint)
            hint = Annotated[hint, option]
        default = Parameter.empty if one.default is MISSING else one.default
        parameters.append(
            Parameter(one.name, Parameter.POSITIONAL_OR_KEYWORD, default=default, annotation=hint)
        )
    signature = Signature(parameters)

    def command(*args, **kwargs):
        given = signature.bind(*args, **kwargs).arguments
        with clear_exits(allow_coarse=given.get("allow_coarse", False)):
            kind(**given).run()

    command.__name__ = kind.__name__.lower()
    command.__doc__ = f"{getdoc(kind)}\n{more}"
    command.__signature__ = signature
    command.__annotations__ = {one.name: one.annotation for one in parameters}
    return command


def _metavar(hint):
    """A short word for what an option takes; None where Typer's own is short."""
    return "WORD" if "Literal" in str(hint) else "NUMBER" if hint in (float, float | None) else None

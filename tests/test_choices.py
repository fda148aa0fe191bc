"""Words that parameters take: constraints, hints, docstrings, help and pages tell the same."""

import inspect
import re
from pathlib import Path
from typing import Literal, get_args, get_origin, get_type_hints

import pytest
from typer.main import get_command

from public import ESTIMATORS
from sklearn_mcmd._choices import RuleMethod, Strictness, choices_of
from sklearn_mcmd._sklearn import StrOptions
from sklearn_mcmd.cli import app

DOCS = Path(__file__).parents[1] / "docs"
CLASSES = {type(estimator).__name__: type(estimator) for estimator in ESTIMATORS.values()}


def words_in(hint):
    """The words of all literals in a type hint."""
    if get_origin(hint) is Literal:
        return set(get_args(hint))
    return set().union(*(words_in(part) for part in get_args(hint)))


def options_of_verbs():
    """Each option of a verb that is one of some words: its words and its help."""
    for name, verb in get_command(app).commands.items():
        hints = get_type_hints(verb.loaded.callback, include_extras=True)
        for option, hint in hints.items():
            if words := words_in(hint):
                help = next(part.help for part in get_args(hint) if hasattr(part, "help"))
                yield pytest.param(words, help, id=f"{name} {option}")


@pytest.mark.parametrize("name", CLASSES)
def test_hints_and_docstrings_name_the_words_that_constraints_take(name):
    kind = CLASSES[name]
    hints, text = get_type_hints(kind.__init__), inspect.getdoc(kind)
    for parameter, constraints in kind._parameter_constraints.items():
        words = {word for one in constraints if isinstance(one, StrOptions) for word in one.options}
        if hinted := words_in(hints.get(parameter, str)):
            assert hinted == words, parameter
        told = re.search(rf"^{parameter}( :|,).*?(?=^\S|\Z)", text, re.M | re.S)
        if words and parameter != "features":  # too many; the guide lists them
            assert told, parameter
            assert [word for word in words if f'"{word}"' not in told[0]] == [], parameter


@pytest.mark.parametrize(("words", "help"), list(options_of_verbs()))
def test_the_help_of_an_option_tells_what_each_of_its_words_does(words, help):
    told = {
        word for part in re.findall(r"((?:[\w-]+, )*[\w-]+): ", help) for word in part.split(", ")
    }
    assert words - told == set()


@pytest.mark.parametrize(
    ("page", "words"),
    [
        ("outliers.rst", Strictness),
        ("user_guide.rst", RuleMethod),
        ("command_line.rst", Strictness),
    ],
)
def test_pages_name_each_level_and_method(page, words):
    text = (DOCS / page).read_text()
    assert [w for w in choices_of(words) if not re.search(rf'(``|")({w}\1|{w}"``)', text)] == []

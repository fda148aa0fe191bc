"""The words that parameters take, each set once.

Constraints, type hints and the command line read them here. The command line cannot read them from
the estimators, whose import takes long. What a word does is told where the work is done: levels of
strictness in ``outliers/_model.py``, methods in ``planes/_rules.py``. Tests hold that these know
every word, and that docstrings, help and pages name it.
"""

from typing import Any, Literal, get_args

ChangeCorrection = Literal["fdr", "sidak", "none"]
Correction = Literal["sidak", "bonferroni", "none"]
Criterion = Literal["crease", "eigenvalue", "surface_variation"]
EliminationRule = Literal["single", "all"]
Mode = Literal["drop", "mark"]
OutlierMethod = Literal["mcmd_z", "mcmd_md"]
RuleMethod = Literal[OutlierMethod, "pca"]
Strictness = Literal["isolated", "groups", "surfaces"]
Surface = Literal["orthogonal", "vertical"]
Test = Literal["w", "tau", "t"]


def choices_of(choice: Any) -> set[str]:
    """The words of one of these."""
    return set(get_args(choice))

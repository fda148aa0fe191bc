"""Messages of estimators about parameters, rewritten for the command line's options and files."""

import re

__all__ = ["in_words_of_options"]

# Parameters that are options of a verb; `name=value` becomes `--name value`.
OPTIONS = (
    *("alpha", "contamination", "criterion", "cutoff", "false_positive_rate", "features"),
    *("max_angle", "max_distance", "max_gap", "memory", "method", "min_angle"),
    *("min_region_size", "n_jobs", "n_neighbors", "noise_scale", "orientation", "radius"),
    *("max_outlier_rate", "random_state", "robust_start", "sigma0", "strictness", "surface"),
    "threshold",
)
# Whole phrases are replaced first; then remaining parameters are replaced one by one.
PHRASES = (
    (
        r"\bcolumns=\{(.*?)\}",
        lambda found: "--columns " + re.sub(r"['\"]|(?<=[:,]) ", "", found[1]).replace(":", "="),
    ),
    (r"\bsensor_origin\b", "--sensor"),
    (
        r"n_samples=(\d+) is too few for planes in 3D: at least (\d+) are needed\.",
        r"too few points for a plane: \1, and at least \2 are needed.",
    ),
    (r"n_samples=(\d+) is too few to test a plane in 3D", r"too few points to test a plane (\1)"),
    (
        r"X has (\d+) distinct point\(s\) in n_samples=(\d+), which is too few to test a plane "
        r"in 3D",
        r"too few distinct points to test a plane (\1 of \2)",
    ),
    (r"The (\d+) points of X\b", r"the \1 points"),
    (
        r"n_neighbors=(\d+) is more than the number of distinct points, (\d+) of n_samples=\d+: "
        r"neighborhoods of all of them are used\.",
        lambda found: (
            f"there {'is' if found[2] == '1' else 'are'} only {found[2]} distinct "
            f"point{'s'[: found[2] != '1']}, fewer than the {found[1]} of a neighborhood: each "
            "neighborhood is the whole cloud."
        ),
    ),
    (
        r"X has a coordinate beyond (\S+) in row (\d+): \[(.*?)\]\.",
        lambda found: f"point {int(found[2]) + 1} has a coordinate beyond {found[1]}: {found[3]}.",
    ),
    (r"X spans no more than (.*?)\. Scale it up\.", r"the points span no more than \1."),
    (r"max_outlier_rate=(\S+) in 3D asks", r"--max-outlier-rate \1 asks"),
    (r"If all columns are coordinates of like precision, as in the scan", "In the scan"),
)
_GIVEN = re.compile(rf"(?<![-/\w])({'|'.join(OPTIONS)})=(?:'([^']*)'|([^\s,:;]*[^\s,:;.]))")
_NAMED = re.compile(rf"(?<![-/\w])({'|'.join(o for o in OPTIONS if '_' in o)})\b")


def in_words_of_options(message):
    """An estimator's message with options in place of parameters."""
    for phrase, words in PHRASES:
        message = re.sub(phrase, words, message)
    message = _GIVEN.sub(lambda found: f"{_option(found[1])} {found[2] or found[3]}", message)
    return _NAMED.sub(lambda found: _option(found[1]), message)


def _option(parameter):
    return f"--{parameter.replace('_', '-')}"

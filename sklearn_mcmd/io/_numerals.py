"""Numbers of text as languages and programs write them."""

import re

import numpy as np

MISSING = {"", "na", "n/a", "null", "none"}  # words for no number, in lower case
SWAPPED = str.maketrans(",.", ".,")  # decimal commas and points
# Commas that can only separate thousands: several of them, or before a point.
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:(?:,\d{3})+\.\d*|(?:,\d{3}){2,})")
# Swiss and French: an apostrophe or a blank that does not break, also as bytes of Latin-1.
MARKS = r"['\u2019\xa0\u202f\x92\udca0\udc92]"
MARKED = re.compile(rf"[+-]?[1-9]\d{{0,2}}({MARKS})\d{{3}}(?:\1\d{{3}})*(?:\.\d*)?")
FORTRAN = re.compile(r"(\d\.\d*|\.\d+)[dD]([+-]?\d+)")  # always with a point
WINDOWS = re.compile(  # older and newer libraries of C
    r"([+-]?)(?:1[.,]#(IND|QNAN|SNAN|INF)[\de]*(?:[+-]\d+)?|nan\(\w*\))", re.IGNORECASE
)


def number_of(cell, comma=False):
    """The number of a cell, NaN where it is missing, and None of words.

    `comma` says that decimals follow a comma, and points separate thousands.
    """
    if comma:
        cell = cell.translate(SWAPPED)
    if "," in cell and THOUSANDS.fullmatch(cell):
        cell = cell.replace(",", "")
    elif marked := MARKED.fullmatch(cell):
        cell = cell.replace(marked[1], "")
    try:
        return float(FORTRAN.sub(r"\1e\2", cell)) if "_" not in cell else None
    except ValueError:
        return np.nan if cell.lower() in MISSING else None


def filled(cell):
    """The number of a cell that may be missing; raises ValueError for words."""
    value = number_of(cell.strip())
    if value is None:
        raise ValueError
    return value


def named_nans(line):
    """A line with nan and inf for what Windows writes, such as -1.#IND."""
    if "#" not in line and "(" not in line:
        return line
    return WINDOWS.sub(lambda m: m[1] + ("inf" if str(m[2]).upper() == "INF" else "nan"), line)


def plain_numbers(line, comma):
    """A line without a comment after it, with numbers as NumPy reads them, if it can."""
    line = named_nans(line).partition("#")[0]
    if comma:
        line = line.replace(".", "_").replace(",", ".")  # NumPy reads no _
    return FORTRAN.sub(r"\1e\2", line) if "d" in line or "D" in line else line

"""How benchmarks print: rows of cells under a head, numbers with as many digits as asked."""

import csv


def texts(rows, digits):
    return [
        [
            cell if isinstance(cell, str) else f"{cell:,.{digits * (not isinstance(cell, int))}f}"
            for cell in row
        ]
        for row in rows
    ]


def table_lines(head, rows, digits=1):
    """The lines of a table; the first column is text."""
    rows = texts([head, *rows], digits)
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    for first, *cells in rows:
        aligned = (cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True))
        yield "  ".join([first.ljust(widths[0]), *aligned])


def print_table(title, head, rows, digits=1):
    print(f"\n{title}" if title else "")
    for line in table_lines(head, rows, digits):
        print(line, flush=True)


def write_csv(path, rows):
    with open(path, "w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)

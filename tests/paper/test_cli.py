"""``python -m benchmarks.paper``: names and reports."""

from benchmarks.paper import EXPERIMENTS, table4
from benchmarks.paper.__main__ import main


def test_the_list_names_every_table_and_figure(capsys):
    main(["list"])
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert names == list(EXPERIMENTS) == ["table1", "table4"]


def test_a_name_prints_the_report(capsys):
    main(["table4", "--runs", "2", "--seed", "5"])
    assert str(table4(2, seed=5)) in capsys.readouterr().out

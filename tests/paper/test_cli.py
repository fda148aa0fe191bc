"""``python -m benchmarks.paper``: names, files and errors."""

from benchmarks.paper import EXPERIMENTS, table4
from benchmarks.paper.__main__ import main


def test_the_list_names_every_table_and_figure(capsys):
    main(["list"])
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert names == list(EXPERIMENTS)
    assert {f"table{i}" for i in (1, 4, 6)} <= set(names)
    assert {f"figure{i}" for i in (4, *range(10, 14))} <= set(names)


def test_a_name_prints_the_report_and_out_holds_its_plot_and_text(tmp_path, capsys):
    folder = tmp_path / "new" / "folder"
    main(["table4", "--runs", "2", "--seed", "5", "--out", str(folder)])
    report = str(table4(2, seed=5))
    assert report in capsys.readouterr().out
    assert sorted(p.name for p in folder.iterdir()) == ["table4.png", "table4.txt"]
    assert (folder / "table4.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "table4.txt").read_text(encoding="utf-8").strip() == report

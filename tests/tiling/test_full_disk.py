"""Disks that are full or read-only: a clear line, inputs as they were, and a way to go on."""

import errno
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.tiling import _folder, process_files
from tiled import PCA, VERBS, names_in

SIZE = {"tile_size": 800}


@pytest.fixture
def disk(tmp_path):
    """A small disk, and a function that gives it options."""
    folder = tmp_path / "disk"
    folder.mkdir()

    def mount(options):
        command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
        return subprocess.run(command, capture_output=True).returncode

    if shutil.which("mount") is None or mount("size=1m"):
        pytest.skip("no right to mount a disk")
    yield folder, lambda options: mount(f"remount,{options}")
    subprocess.run(["umount", "--lazy", str(folder)], check=True)  # arrays may be mapped still


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("verb", ["outliers", pytest.param("regions", marks=pytest.mark.slow)])
def test_a_full_disk_is_said_and_more_room_helps(disk, small_file, monkeypatch, verb):
    folder, remount = disk
    expected, target = small_file.with_name("expected.las"), folder / "out.las"
    before = small_file.read_bytes()
    process_files(small_file, expected, VERBS[verb], **SIZE)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=1e9))
    refused, kept = [], []
    for size in range(40, 1_200, 40):  # too little for cells, for arrays, or for the output
        remount(f"size={size}k")
        try:
            process_files(small_file, target, VERBS[verb], **SIZE)
        except ValueError as err:
            refused.append(str(err).lower())
            kept += names_in(folder)
        else:
            break
    assert set(kept) == {"out.las.tiles"}
    assert len(refused) >= 3
    assert not [why for why in refused if "no space left" not in why and "tiles failed" not in why]
    assert target.read_bytes() == expected.read_bytes()
    assert small_file.read_bytes() == before


def test_a_read_only_disk_is_refused_before_the_work(disk, small_file):
    folder, remount = disk
    remount("ro")
    with pytest.raises(PointFileError, match=r"out\.las: cannot be written; .* write-protected"):
        process_files(small_file, folder / "out.las", PCA, **SIZE)


def test_a_disk_that_is_full_for_the_cells_is_said(small_file, tmp_path, monkeypatch):
    def full(path, mode, begin=open):
        if Path(path).suffix not in (".points", ".rows"):
            return begin(path, mode)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(_folder, "open", full, raising=False)
    with pytest.raises(PointFileError, match=r"out\.las\.tiles.*: no space left on device"):
        process_files(small_file, tmp_path / "out.las", PCA, **SIZE)
    assert names_in(tmp_path) == ["small.las"]

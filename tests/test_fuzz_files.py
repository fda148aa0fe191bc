"""benchmarks/fuzz_files.py: some broken files of every reader, each time the same ones."""

import importlib
import random
import sys
from pathlib import Path

import pytest

pytest.importorskip("resource")
for module in ("laspy", "lazrs", "plyfile", "pypcd4", "pye57"):
    pytest.importorskip(module)

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))
fuzzer, readers, seeds = map(
    importlib.import_module, ("fuzz_files", "_fuzz_readers", "_fuzz_seeds")
)
sys.path.remove(str(BENCHMARKS))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("reader", fuzzer.READERS)
def test_broken_files_are_read_or_have_one_clear_line(reader, tmp_path):
    read, documented = readers.reader_of(reader, tmp_path)
    whole = [*seeds.seeds_of(reader, tmp_path)]
    rng, path, n_read = random.Random(0), tmp_path / f"in.{fuzzer.READERS[reader]}", 0

    def read_and_count(path):
        nonlocal n_read
        read(path)
        n_read += 1

    n = 20 if reader == "store" else 150
    for _ in range(n):
        path.write_bytes(seeds.prepared(reader, fuzzer.mutated(rng, whole, fuzzer.NUMBERS)))
        if (fault := fuzzer.fault_of(read_and_count, documented, path)) is not None:
            raise fault
    assert 0 < n_read < n or (reader == "store" and n_read == n)  # which suppresses its errors

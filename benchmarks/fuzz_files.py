"""Broken files for every reader: each must become a cloud, or one clear line; nothing else.

    python benchmarks/fuzz_files.py --reader ply --executions 100_000

Without ``--reader`` all take their turn. Inputs are small valid files with changed bits, numbers,
ends and joints. The process may take SPARE bytes more for each. A failure is any exception but the
documented one, memory by which the process grows more than the file can justify, and more than
PATIENCE seconds. It ends the run with its traceback; the file that was read stays in the folder.
"""

import argparse
import faulthandler
import random
import resource
import struct
import sys
import warnings
from contextlib import suppress
from pathlib import Path

from sklearn_mcmd.io._formats import FORMATS

PATIENCE = 10.0  # seconds for a file
SPARE = 2**29
LEAST, BYTES_A_BYTE = 64 * 2**20, 200  # by which a process may grow for a file
LONGEST = 4096  # bytes of an input, unless valid ones are longer
# What is read, and the extension of its files.
READERS = {
    "text": "csv",
    "trajectory": "csv",
    "npz members": "npz",
    "index": "vpc",
    "store": "json",
}
NAMES = [e[1:] for one in FORMATS if one.name not in ("text", "COPC") for e in one.extensions]
READERS |= {name: name for name in NAMES}
NUMBERS = [struct.pack(code, -1) for code in "bhiq"] + [struct.pack("<i", 2**n) for n in (24, 30)]
NUMBERS += [struct.pack("<q", 2**40), struct.pack("<d", 1e308), struct.pack("<d", float("nan"))]
NUMBERS += [b"-1", b"1e400", b"99999999999", b"nan", b"0", b'"', b"\n", b"\0"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--reader", choices=READERS, action="append")
    parser.add_argument("--executions", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path("fuzzed"))
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore")
    for reader in options.reader or READERS:
        read_broken(reader, options)
        print(f"{reader:12} {options.executions:9,} executions without a failure", flush=True)


def read_broken(reader, options):
    from _fuzz_readers import reader_of
    from _fuzz_seeds import prepared, seeds_of

    rng, path = random.Random(options.seed), options.folder / f"in.{READERS[reader]}"
    read, documented = reader_of(reader, options.folder)
    seeds = [*seeds_of(reader, options.folder)]
    for seed in seeds:  # loads what readers import when they are first asked
        path.write_bytes(prepared(reader, seed))
        with suppress(documented):
            read(path)
    longest = max(LONGEST, *map(len, seeds))
    most = resource.getrlimit(resource.RLIMIT_AS)[1]
    for _ in range(options.executions):
        data = prepared(reader, mutated(rng, seeds, NUMBERS)[:longest])
        path.write_bytes(data)
        before = most_memory()
        resource.setrlimit(resource.RLIMIT_AS, (address_space() + SPARE, most))
        faulthandler.dump_traceback_later(PATIENCE, exit=True)
        failure = fault_of(read, documented, path)
        faulthandler.cancel_dump_traceback_later()
        if failure is not None:
            raise failure
        if (grown := most_memory() - before) > LEAST + BYTES_A_BYTE * len(data):
            raise MemoryError(f"{path} of {len(data):,} bytes took {grown:,}")


def fault_of(read, documented, path):
    """The error of a reader that is not the documented one, in one line; None if all is well."""
    try:
        read(path)
    except documented as err:
        is_one_line = str(err) and "\n" not in str(err).strip()
        return None if is_one_line and not isinstance(err.__cause__, MemoryError) else err
    except BaseException as err:
        return err
    return None


def mutated(rng, seeds, tokens):
    """A valid file with one to eight changes."""
    data = bytearray(rng.choice(seeds))
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        at, other, token = rng.randrange(len(data) + 1), rng.choice(seeds), rng.choice(tokens)
        start = rng.randrange(len(other))
        change = rng.randrange(6)
        if change == 0 and at < len(data):
            data[at] ^= 1 << rng.randrange(8)
        elif change == 1:
            data[at : at + len(token)] = token
        elif change == 2:
            data[at:at] = token
        elif change == 3:
            del data[at : at + rng.randrange(1, 20)]
        elif change == 4:
            del data[at:]
        else:
            data[at:] = other[start:]
    return bytes(data)


def address_space():
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def most_memory():
    """The most bytes of memory that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


if __name__ == "__main__":
    sys.exit(main())

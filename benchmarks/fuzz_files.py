"""Broken files for every reader: each must become a cloud, or one clear line; nothing else.

    python benchmarks/fuzz_files.py --reader ply --executions 100_000 --seconds 600

Without ``--reader`` all take their turn. Inputs are small valid files with changed bits, numbers,
tokens, ends and joints. Where atheris is installed (``pip install atheris``), its libFuzzer changes
them, guided by what the readers and their libraries reach. They are read in a process that may take
SPARE bytes more than for valid files. A failure is any exception but the documented one, an
allocation that is refused or by which the process grows more than the file can justify, the death
of the process, and more than PATIENCE seconds. The smallest input of each is kept, with its
traceback.
"""

import argparse
import hashlib
import mmap
import os
import random
import re
import resource
import struct
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from contextlib import nullcontext, suppress
from pathlib import Path

from sklearn_mcmd.io._formats import FORMATS

PATIENCE, BEGIN = 10.0, 120.0  # seconds for a file, and until the first
SPARE = 2**29
LEAST, BYTES_A_BYTE = 64 * 2**20, 200  # by which a process may grow for a file
LONGEST = 4096  # bytes of an input, unless valid ones are longer
# What is read, and the extension of its files.
READERS = {"text": "csv", "trajectory": "csv", "npz members": "npz", "index": "vpc"}
READERS |= {"settings": "toml", "store": "json"}
NAMES = [e[1:] for one in FORMATS if one.name not in ("text", "COPC") for e in one.extensions]
READERS |= {name: name for name in NAMES}
GUIDED = ["sklearn_mcmd.io", "sklearn_mcmd.tiling", "sklearn_mcmd.cli", "laspy", "plyfile"]
GUIDED += ["pypcd4", "pye57", "numpy.lib", "zipfile", "csv", "json", "tomllib"]
NUMBERS = [struct.pack(code, -1) for code in "bhiq"] + [struct.pack("<i", 2**n) for n in (24, 30)]
NUMBERS += [struct.pack("<q", 2**40), struct.pack("<d", 1e308), struct.pack("<d", float("nan"))]
NUMBERS += [b"-1", b"1e400", b"99999999999", b"nan", b"0", b'"', b"\n", b"\0"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--reader", choices=READERS, action="append")
    parser.add_argument("--executions", type=int, default=10_000)
    parser.add_argument("--seconds", type=float, default=600.0, help="for each reader")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, default=Path("fuzzed"), help="folder for failures")
    parser.add_argument("--unguided", action="store_true", help="without atheris")
    parser.add_argument("--worker", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.worker:
        return _work(args.reader[0], args)
    args.keep.mkdir(parents=True, exist_ok=True)
    for reader in args.reader or READERS:
        begin = time.monotonic()
        n = _watch(reader, args)
        hours = (time.monotonic() - begin) / 3600
        n_found = len(list(args.keep.glob(f"{reader.replace(' ', '-')}-*.txt")))
        print(f"{reader:12} {n:9,} executions {hours:6.3f} h {n_found:3} failures", flush=True)
    return 0


def _watch(reader, args):
    """Let processes read, one after the other; returns how many files were read."""
    end, n_done, n_begun = time.monotonic() + args.seconds, 0, 0
    memory = "/dev/shm" if os.path.isdir("/dev/shm") else None
    with tempfile.TemporaryDirectory(dir=memory) as folder:
        told, log = Path(folder) / "told", Path(folder) / "log"
        while n_done < args.executions and time.monotonic() < end:
            told.write_bytes(bytes(8))
            command = [sys.executable, __file__, "--worker", folder, "--reader", reader]
            command += ["--executions", args.executions - n_done, "--keep", args.keep.resolve()]
            command += ["--seed", args.seed + n_begun] + ["--unguided"] * args.unguided
            with open(log, "wb") as file:
                worker = subprocess.Popen([*map(str, command)], stdout=file, stderr=file)
            n, since = 0, time.monotonic() + BEGIN
            while worker.poll() is None and time.monotonic() < min(end, since + PATIENCE):
                time.sleep(0.1)
                (now,) = struct.unpack("<q", told.read_bytes())
                if now != n:
                    n, since = now, time.monotonic()
            is_late, is_hung = time.monotonic() >= end, worker.poll() is None
            worker.kill()
            if worker.wait() != 0 and not is_late:
                what = "hang" if is_hung else f"exit {worker.returncode}"
                words = f"{what}\n{log.read_bytes()[-4000:].decode(errors='replace')}"
                path = Path(folder) / f"in.{READERS[reader]}"
                _keep(args.keep, reader, path.read_bytes(), what, words, what)
            n_done, n_begun = n_done + struct.unpack("<q", told.read_bytes())[0], n_begun + 1
    return n_done


def _work(reader, args):
    """Read broken files until there were enough, or libraries have leaked too much memory."""
    guide = None
    if not args.unguided:
        try:
            import atheris as guide
        except ImportError:
            print("without atheris: unguided")
    warnings.simplefilter("ignore")
    path = args.worker / f"in.{READERS[reader]}"
    # What is guided must be imported within; some libraries are when the first file is read.
    with guide.instrument_imports(include=GUIDED) if guide else nullcontext():
        from _fuzz_readers import reader_of
        from _fuzz_seeds import prepared, seeds_of

        read, documented = reader_of(reader, args.worker)
        seeds = [*seeds_of(reader, args.worker)]
        for seed in seeds:
            path.write_bytes(prepared(reader, seed))
            with suppress(documented):
                read(path)
    with open(args.worker / "told", "r+b") as file:
        told = mmap.mmap(file.fileno(), 8)
    n, limit = 0, _size() + SPARE

    def one(data):
        nonlocal n
        data = prepared(reader, data)
        path.write_bytes(data)
        before, failure = _largest(), fault_of(read, documented, path)
        if (grown := _largest() - before) > LEAST + BYTES_A_BYTE * len(data):
            _keep(args.keep, reader, data, "memory", f"grew by {grown:,} bytes", "")
        if failure is not None:
            first = failure.__cause__ or failure
            place = traceback.extract_tb(first.__traceback__)[-1]
            words = "".join(traceback.format_exception(failure))
            key = f"{type(first)} {place.filename} {place.lineno}"
            _keep(args.keep, reader, data, type(failure).__name__, words, key)
        n += 1
        told[:] = struct.pack("<q", n)
        if n % 100 == 0 and _size() > limit - SPARE // 2:
            os._exit(0)

    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    longest = max(LONGEST, *map(len, seeds))
    found = (token for seed in seeds for token in re.findall(rb"[A-Za-z_]{3,}|[\d.]+", seed))
    tokens = sorted({*found, *NUMBERS})
    if guide is None:
        rng = random.Random(args.seed)
        for _ in range(args.executions):
            one(mutated(rng, seeds, tokens)[:longest])
    else:
        _guided(guide, args, seeds, tokens, longest, one)
    return 0


def _guided(guide, args, seeds, tokens, longest, one):
    """Let libFuzzer change the seeds."""
    corpus, words = args.worker / "corpus", args.worker / "words"
    corpus.mkdir(exist_ok=True)
    for i, seed in enumerate(seeds):
        (corpus / f"seed{i}").write_bytes(seed)
    escaped = ("".join(map(r"\x{:02x}".format, token)) for token in tokens)
    words.write_text("\n".join(map('"{}"'.format, escaped)))
    options = f"-runs={args.executions} -max_len={longest} -len_control=0 -seed={args.seed + 1} "
    options += f"-dict={words} -rss_limit_mb=0 -timeout=1000 -artifact_prefix={args.worker}/"
    guide.Setup([sys.argv[0], str(corpus), *options.split()], one)
    guide.Fuzz()


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


def _keep(folder, reader, data, what, words, key):
    """Keep the smallest input of each failure."""
    digest = hashlib.sha256(key.encode()).hexdigest()[:8]
    kept = folder / f"{reader} {what} {digest}.bin".replace(" ", "-")
    if not kept.exists() or len(data) < kept.stat().st_size:
        kept.write_bytes(data)
        kept.with_suffix(".txt").write_text(words)


def _size():
    """Bytes of address space."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * mmap.PAGESIZE


def _largest():
    """The most bytes of memory that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


if __name__ == "__main__":
    sys.exit(main())

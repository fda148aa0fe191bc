"""Small files that would take hours or gigabytes, end the process, or ask the network.

Each has one clear line. All are read by another process, which gets 10 seconds and 500 MB for each
of them. Most are the smallest of their kind that `benchmarks/fuzz_files.py` found.
"""

import io
import re
import socketserver
import struct
import subprocess
import sys
import threading
import warnings
import zipfile

import numpy as np
import pytest

from e57_files import with_xml, write_scans
from sklearn_mcmd.io import PointFileError, read_points

if sys.platform != "linux":
    pytest.skip("limits memory as Linux does", allow_module_level=True)
for library in ("laspy", "lazrs", "plyfile", "pypcd4"):
    pytest.importorskip(library)
READ_ALL = """
import os, resource, signal, sys
from pathlib import Path
import laspy, lazrs, plyfile, pye57, pypcd4
from sklearn_mcmd.io import PointFileError, read_points
most = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + 500_000_000
for path in sorted(Path(sys.argv[1]).iterdir()):
    print(path.name, end=" ", flush=True)
    if not (child := os.fork()):
        signal.alarm(10)
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        try:
            told = f"read {len(read_points(path))}"
        except PointFileError as err:
            told = f"refused {err}"
        print(told, flush=True)
        os._exit(0)
    if status := os.waitpid(child, 0)[1]:
        print("ended by", status, flush=True)
"""


def outcomes(folder):
    """What another process says of each file of a folder."""
    done = subprocess.run(
        [sys.executable, "-c", READ_ALL, folder], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return dict(line.split(maxsplit=1) for line in done.stdout.splitlines())


# ---- counts without bytes ----------------------------------------------------------------

HUGE = 10**18


def npy(shape, kind="'<f8'", data=bytes(24)):
    header = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}}}".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


def fields(x, *others):
    return str([(axis, x) for axis in "xyz"] + list(others))


def npz(*members, kind=zipfile.ZIP_STORED, change=None):
    """An NPZ of names and bytes, whose directory may be changed."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", kind) as file, warnings.catch_warnings(action="ignore"):
        for name, data in members:
            file.writestr(name, data)
        for member in file.filelist if change else ():
            change(member)
    return buffer.getvalue()


def share(member):
    """Let a member reach over the others that follow."""
    member.compress_size *= 2


def las(format_id, points_at, n_points):
    """A header of LAS 1.2, and nothing behind it."""
    head = bytearray(227)
    head[:4], head[24:26] = b"LASF", b"\x01\x02"
    head[94:111] = struct.pack("<HIIBHI", 227, points_at, 0, format_id, 20, n_points)
    return bytes(head)


PLY = b"ply\nformat %s 1.0\nelement %s 99999999\nproperty %s x\nend_header\n0\n"
PCD = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT %s 1 1\nWIDTH 5\nPOINTS %s\nDATA %s\n"
PACKED = PCD % (b"1", b"5", b"binary_compressed")
TABLE = npy((100, 3), data=bytes(2400))
NUMBERS = "its numbers need .* bytes"
FILES = {  # by name: bytes, and what the error says
    "rows.npy": (npy((10**8, 3)), NUMBERS),
    "no_row.npy": (npy((0, HUGE)), NUMBERS),
    "no_column.npy": (npy((HUGE, 0)), NUMBERS),
    "empty_strings.npy": (npy((10**9, 3), "'|S0'"), NUMBERS),
    "empty_fields.npy": (npy((10**9,), fields("|S0")), NUMBERS),
    "field_of_field.npy": (
        npy((1,), fields("<f8", ("a", [("b", "<f8", (0, 10**9))]))),
        NUMBERS,
    ),
    "empty_fields_of_field.npy": (
        npy((1,), fields("<f8", ("a", [("b", "<f8", (0,))], (10**9,)))),
        NUMBERS,
    ),
    "header.npy": (b"\x93NUMPY\x02\x00\xff\xff\xff\x3f {", "cannot be read"),
    "bzip2.npz": (npz(("xyz.npy", TABLE), kind=zipfile.ZIP_BZIP2), "'xyz.npy' is compressed as N"),
    "shared.npz": (
        npz(*((f"{a}.npy", TABLE) for a in ("xyz", "b", "c")), change=share),
        "its members need .* bytes",
    ),
    "twice.npz": (npz(("xyz.npy", TABLE), ("xyz.npy", TABLE)), "holds two arrays 'xyz'"),
    "no_suffix.npz": (npz(("xyz.npy", TABLE), ("a", npy((10**8, 3)))), "the numbers of 'a' need"),
    "deflated.npz": (
        npz(("xyz.npy", npy((10**8, 3))), kind=zipfile.ZIP_DEFLATED),
        "the numbers of 'xyz.npy' need",
    ),
    "names.npz": (
        npz(*((f"a\n\x1b[2J{i}.npy", npy((0,), data=b"")) for i in range(999))),
        ".{,100}needs an array xyz of shape .{,350}$",
    ),
    "text.ply": (PLY % (b"ascii", b"vertex", b"double"), "its values need"),
    "lists_in_text.ply": (PLY % (b"ascii", b"face", b"list uchar int"), "its values need"),
    "lists.ply": (PLY % (b"binary_little_endian", b"face", b"list uchar int"), "its values need"),
    "columns.pcd": (PCD % (b"3333332", b"4", b"binary") + bytes(48), "the columns need"),
    "no_points.pcd": (PCD % (b"99999999", b"0", b"ascii"), "the columns need"),
    "packed.pcd": (PACKED + struct.pack("<II", 2**30, 60) + bytes(30), "compressed points need"),
    "unpacked.pcd": (PACKED + struct.pack("<II", 30, 2**30) + bytes(30), "decompressed points"),
    "before_points.las": (las(0x80, 2**30, 0), "holds no points"),
    "not_compressed.las": (las(0xC0, 227, 10**8) + bytes(30), "truncated: 100000000 points need"),
    "line.xyz": (b"1 2 3\n" + b"1 " * 600_000 + b"\n", "a line has more than 1,000,000 char"),
}

# ---- XML of E57 --------------------------------------------------------------------------

END, MANY, VECTOR = "</e57Root>", 9_000, '<v type="Vector">'


def inside(*parts):
    return [(END, "".join((*parts, END)))]


LEAVES = [f'<a{i} type="Integer"/>' for i in range(MANY)]
PAIR = '<a type="Structure"><b type="Integer"/></a>'
PAIRS = "its XML is .*,... pairs to compare"
PREFIX = '<e57Root xmlns:e="http://www.astm.org/COMMIT/E57/2010-e57-v1.0"'
NO_PROTOTYPE = "points does not say what it holds: no prototype"
XMLS = {  # by name: changes, and what the error says
    "children": (inside(*LEAVES), PAIRS),
    "children_of_child": (inside('<c type="Structure">', *LEAVES, "</c>"), PAIRS),
    "vector_of_one_kind": (inside(VECTOR, PAIR * (MANY // 2), "</v>"), PAIRS),
    "depth": (inside('<a type="Structure">' * MANY, "</a>" * MANY), "its XML is 101 elements deep"),
    # libe57 would read a null pointer.
    "prototype": ([(r"<prototype.*?</prototype>", "")], NO_PROTOTYPE),
    "of_no_points": ([(r"(<points[^>]*>).*?(</points>)", r"\1\2")], NO_PROTOTYPE),
    "another": ([("</data3D>", '<x type="CompressedVector" fileOffset="48"/></data3D>')], "x does"),
    "prefix": ([("<e57Root", PREFIX), (r"<(/?)prototype", r"<\1e:prototype")], "cannot be read"),
    "points": ([(r"<points.*?</points>", "")], "cannot be read"),
    "type": ([('type="CompressedVector"', 'type="Structure"')], "cannot be read"),
    "fields": ([(r"(<prototype[^>]*>).*?(</prototype>)", r"\1\2")], "cannot be read"),
    "end": ([("</e57Root>", "")], "cannot be read"),
}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """An E57 of two scans."""
    scan = np.arange(60.0).reshape(20, 3), {}, {}
    return write_scans(tmp_path_factory.mktemp("plain") / "plain.e57", scan, scan)


@pytest.fixture(scope="module")
def told(tmp_path_factory, plain):
    """What is said of each hostile file."""
    folder = tmp_path_factory.mktemp("hostile")
    for name, (data, _) in FILES.items():
        (folder / name).write_bytes(data)
    for name, (changes, _) in XMLS.items():
        with_xml(plain, folder / f"{name}.e57", *changes)
    return outcomes(folder)


@pytest.mark.parametrize("name", [*FILES, *XMLS])
def test_a_small_file_that_promises_much_is_refused_in_time(told, name):
    said = told[name if name in FILES else f"{name}.e57"]
    assert re.match(f"refused .*{(FILES | XMLS)[name][1]}", said), said


def test_a_table_without_rows_holds_no_points(tmp_path):
    for shape in ((0, 3), (0, 20), (0, 4, 3)):
        np.save(tmp_path / "a.npy", np.empty(shape))
        with pytest.raises(PointFileError, match="holds no points"):
            read_points(tmp_path / "a.npy")


# ---- other places ------------------------------------------------------------------------

XSI = 'xmlns:{0}="http://www.w3.org/2001/XMLSchema-instance"'
ROOT = "<e57Root"
SPACE = "http://www.astm.org/COMMIT/E57/2010-e57-v1.0"
PLACES = {
    "location": [(ROOT, f'{ROOT} {XSI.format("xsi")} xsi:schemaLocation="{SPACE} URL"')],
    "prefix": [(ROOT, f'{ROOT} {XSI.format("q")} q:schemaLocation="{SPACE} URL"')],
    "inner": [("<data3D", f'<data3D {XSI.format("xsi")} xsi:schemaLocation="{SPACE}\n URL"')],
    "type": [(ROOT, f'<!DOCTYPE e57Root SYSTEM "URL">{ROOT}')],
    "entity": [(ROOT, f'<!DOCTYPE e57Root [<!ENTITY % a SYSTEM "URL"> %a;]>{ROOT}')],
    "included": inside('<i:include xmlns:i="http://www.w3.org/2001/XInclude" href="URL"/>'),
    "sheet": [(ROOT, f'<?xml-stylesheet href="URL"?>{ROOT}')],
}
ENCODINGS = {"utf-8": "UTF-8", "utf-16": "UTF-16", "utf-16-le": "UTF-16"}


@pytest.fixture
def server():
    """The address of a server, and what asked it."""
    asked = []

    class Handler(socketserver.StreamRequestHandler):
        timeout = 5

        def handle(self):
            asked.append(self.rfile.readline())

    with socketserver.TCPServer(("127.0.0.1", 0), Handler) as listening:
        threading.Thread(target=listening.serve_forever, args=(0.05,), daemon=True).start()
        yield f"http://127.0.0.1:{listening.server_address[1]}/a.xsd", asked
        listening.shutdown()


def test_no_e57_asks_the_network(tmp_path, plain, server):
    url, asked = server
    folder = tmp_path / "files"
    folder.mkdir()
    for name, changes in PLACES.items():
        for encoding, declared in ENCODINGS.items():
            changed = [(pattern, words.replace("URL", url)) for pattern, words in changes]
            changed = [('encoding="UTF-8"', f'encoding="{declared}"'), *changed]
            with_xml(plain, folder / f"{name}_{encoding}.e57", *changed, encoding=encoding)
    told = outcomes(folder)
    assert asked == []
    assert len(told) == len(PLACES) * len(ENCODINGS)
    for words in told.values():
        assert re.match("refused .*names another place", words), told


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_usual_scans_and_images_are_read_in_all_encodings(tmp_path, plain, encoding):
    image = '<vectorChild type="Structure"><guid type="String">image</guid></vectorChild>'
    changes = [
        ('encoding="UTF-8"', f'encoding="{ENCODINGS[encoding]}"'),
        ("</images2D>", image * 2000 + "</images2D>"),
        (ROOT, f'<!-- a comment -->{ROOT} xmlns:demo="http://demo.org/demo"'),
    ]
    with_xml(plain, tmp_path / "a.e57", *changes, encoding=encoding)
    assert len(read_points(tmp_path / "a.e57")) == 40


def test_an_e57_of_many_scans_is_read(tmp_path, plain):
    one = r"(<data3D[^>]*>).*?(<vectorChild.*?</vectorChild>).*?(</data3D>)"
    with_xml(plain, tmp_path / "a.e57", (one, lambda m: m[1] + m[2] * 200 + m[3]))
    assert len(read_points(tmp_path / "a.e57")) == 200 * 20

"""Small files that would take hours or gigabytes, or ask the network: each has one clear line.

All are read by another process, which gets 10 seconds and 500 MB for each of them.
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
READ_ALL = """
import os, resource, signal, sys
from pathlib import Path
import pye57
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


# ---- arrays ------------------------------------------------------------------------------

HUGE = 10**18


def npy(shape, kind="'<f8'", data=bytes(24)):
    header = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}}}".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


def fields(x, *others):
    return str([(axis, x) for axis in "xyz"] + list(others))


ARRAYS = {
    "no row": npy((0, HUGE)),
    "no column": npy((HUGE, 0)),
    "empty strings": npy((10**9, 3), "'|S0'"),
    "empty fields": npy((10**9,), fields("|S0")),
    "a field of a field": npy((1,), fields("<f8", ("a", [("b", "<f8", (0, 10**9))]))),
    "empty fields of a field": npy((1,), fields("<f8", ("a", [("b", "<f8", (0,))], (10**9,)))),
}


def archive(*members, kind=zipfile.ZIP_STORED, change=None):
    """An NPZ of names and bytes, whose directory may be changed."""
    buffer = io.BytesIO()
    with (
        zipfile.ZipFile(buffer, "w", kind) as file,
        warnings.catch_warnings(action="ignore"),
    ):
        for name, data in members:
            file.writestr(name, data)
        for member in file.filelist if change else ():
            change(member)
    return buffer.getvalue()


def share(member):
    """Let a member reach over the others that follow."""
    member.compress_size *= 2


TABLE = npy((100, 3), data=bytes(2400))
ARCHIVES = {
    "bzip2": archive(("xyz.npy", TABLE), kind=zipfile.ZIP_BZIP2),
    "shared": archive(*((f"{a}.npy", TABLE) for a in ("xyz", "b", "c")), change=share),
    "twice": archive(("xyz.npy", TABLE), ("xyz.npy", TABLE)),
    "no suffix": archive(("xyz.npy", TABLE), ("other", npy((10**8, 3)))),
    "deflated": archive(("xyz.npy", npy((10**8, 3))), kind=zipfile.ZIP_DEFLATED),
}

# ---- XML of E57 --------------------------------------------------------------------------

END, MANY, VECTOR = "</e57Root>", 9_000, '<v type="Vector">'


def inside(*parts):
    return [(END, "".join((*parts, END)))]


LEAVES = [f'<a{i} type="Integer"/>' for i in range(MANY)]
PAIR = '<a type="Structure"><b type="Integer"/></a>'
XMLS = {
    "children": inside(*LEAVES),
    "children of a child": inside('<c type="Structure">', *LEAVES, "</c>"),
    "a vector of one kind": inside(VECTOR, PAIR * (MANY // 2), "</v>"),
    "depth": inside('<a type="Structure">' * MANY, "</a>" * MANY),
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
    for extension, kinds in ((".npy", ARRAYS), (".npz", ARCHIVES)):
        for name, data in kinds.items():
            (folder / f"{name.replace(' ', '_')}{extension}").write_bytes(data)
    for name, changes in XMLS.items():
        with_xml(plain, folder / f"{name.replace(' ', '_')}.e57", *changes)
    return outcomes(folder)


REASONS = {
    **dict.fromkeys(ARRAYS, "its numbers need .* bytes"),
    "bzip2": "'xyz.npy' is compressed as NumPy does not",
    "shared": "its members need .* bytes",
    "twice": "holds two arrays 'xyz'",
    "no suffix": "the numbers of 'other' need",
    "deflated": "the numbers of 'xyz.npy' need",
    **dict.fromkeys(XMLS, "its XML is .*,... pairs to compare"),
    "depth": "its XML is 101 elements deep",
}


@pytest.mark.parametrize("name", REASONS)
def test_a_small_file_that_promises_much_is_refused_in_time(told, name):
    said = next(words for file, words in told.items() if file[:-4] == name.replace(" ", "_"))
    assert re.match(f"refused .*{REASONS[name]}", said), said


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
        assert re.match("refused .*(names another place|declares a type of document)", words), told


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_usual_scans_and_images_are_read_in_all_encodings(tmp_path, plain, encoding):
    image = '<vectorChild type="Structure"><guid type="String">schemaLocation</guid></vectorChild>'
    changes = [
        ('encoding="UTF-8"', f'encoding="{ENCODINGS[encoding]}"'),
        ("</images2D>", image * 2000 + "</images2D>"),
        (ROOT, f'<!-- <!DOCTYPE a> -->{ROOT} xmlns:demo="http://demo.org/schemaLocation"'),
    ]
    with_xml(plain, tmp_path / "a.e57", *changes, encoding=encoding)
    assert len(read_points(tmp_path / "a.e57")) == 40


def test_an_e57_of_many_scans_is_read(tmp_path, plain):
    one = r"(<data3D[^>]*>).*?(<vectorChild.*?</vectorChild>).*?(</data3D>)"
    with_xml(plain, tmp_path / "a.e57", (one, lambda m: m[1] + m[2] * 200 + m[3]))
    assert len(read_points(tmp_path / "a.e57")) == 200 * 20

"""E57 files, written by pye57."""

import re
import struct

import pytest

from benchmarks._fuzz_seeds import PAGE, crc32c

pye57 = pytest.importorskip("pye57")


def write_scans(path, *scans):
    """The path of a file of scans: coordinates (n, 3), other fields, and what pye57 takes."""
    with pye57.E57(str(path), mode="w") as file:
        for xyz, fields, options in scans:
            points = {f"cartesian{axis}": xyz[:, i].astype(float) for i, axis in enumerate("XYZ")}
            file.write_scan_raw(points | fields, **options)
    return path


def with_xml(source, target, *changes, encoding="utf-8"):
    """A copy with another text or encoding of its XML, and right checksums."""
    raw = source.read_bytes()
    at, length = struct.unpack_from("<QQ", raw, 24)
    data = b"".join(raw[i : i + PAGE - 4] for i in range(0, len(raw), PAGE))
    at = at // PAGE * (PAGE - 4) + at % PAGE
    xml = data[at : at + length].decode()
    for pattern, words in changes:
        xml, n = re.subn(pattern, words, xml, flags=re.DOTALL)
        assert n, pattern
    data = data[:at] + (xml := xml.encode(encoding))
    data += bytes(-len(data) % (PAGE - 4))
    size = len(data) // (PAGE - 4) * PAGE
    head = struct.pack("<Q8xQ", size, len(xml))
    data = data[:16] + head[:8] + data[24:32] + head[16:] + data[40:]
    pages = (data[i : i + PAGE - 4] for i in range(0, len(data), PAGE - 4))
    target.write_bytes(b"".join(page + struct.pack(">I", crc32c(page)) for page in pages))
    return target

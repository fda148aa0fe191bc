"""Small valid files of each reader, from which `fuzz_files` makes broken ones."""

import io
import json
import struct
import warnings
from pathlib import Path

import numpy as np

from sklearn_mcmd.io import PointCloud, write_points

PARTS = b"--next member--"  # between the names and bytes of an NPZ's members
PAGE = 1024  # of E57: bytes with four of a checksum
DEEP = 2_000 * b"["  # deeper than parsers call themselves
TEXTS = [
    b"x y z\n0 0 0\n1 0 0\n0 1 9\n",
    b"# a title\n//easting,northing,height,label\n1.5;2;3;4\n2;3;nan;\n",
    b"3\n0 0 0 12 255 0 0\n1 0 0 NA 1 2 3\n0 1 2 7 9 9 9\n",
    b'X[m],Y[m],Z[m],"date, time",class\n1,2,3,2026-01-01,2\n4e9,-5,6,none,7\n',
    "\ufeffPOINT_X\tPOINT_Y\tELEV\tgr\u00fcn\n1,5\t2\t3\t4\n".encode(),
    b"time,x,y,z\n10,0,0,2\n11,8,0,2\n",
    b"gps_time y x z roll\n1e9 0 0 2 .5\n1000000001 8 0 2 .5\n",
]
POSE = b"1 2 3\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n1 2 3 1\n"
SCANS = [
    b"2\n2\n" + POSE + b"1 2 3 .5\n0 0 0 0.5\n4 5 6 1\n-1 2.5 1e1 0\n",
    2 * (b"1\n3\n" + POSE + b"1 2 3 .5 255 0 9\n4 5 6 1 0 0 0\n7 8 8 0 1 2 3\n"),
]
INDEX = {"features": [{"assets": {"data": {"href": "./a.las", "roles": ["data"]}}}]}
STORES = [
    {"key": "k", "constants": {"dtype": "<f8", "step": 0.0}},
    {"key": "m", "inputs": [[1, 2]], "moves": [["a", "b", [1, 2]]], "report": {"n": 1}},
]


def seeds_of(reader, folder):
    """Bytes of valid files, which are made in a folder."""
    told = {
        "text": TEXTS,
        "ptx": SCANS,
        "trajectory": TEXTS[-2:],
        "index": [json.dumps(INDEX).encode(), json.dumps(INDEX, indent=1).encode(), DEEP],
        "store": _stores(Path(folder)),
    }
    if reader in told:
        return told[reader]
    return [seed for seed in _files(reader, Path(folder)) if len(seed) <= 8000]


def prepared(reader, data):
    """Data with right checksums, for a part of all, so that more is reached than the checks."""
    if reader == "npz members":
        return _joined_members(data)
    return _with_checksums(data) if reader == "e57" and sum(data[-64:]) % 8 else data


def _joined_members(data):
    """An NPZ whose members have right checksums: alternately names and bytes."""
    import zipfile

    parts, buffer = data.split(PARTS), io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of names that come twice
        for name, member in zip(parts[::2], parts[1::2], strict=False):
            archive.writestr(name[:40].decode("latin-1").replace("\0", "") or "x", member)
    return buffer.getvalue()


def _with_checksums(data):
    """An E57 whose pages have right checksums, so that more of it than these is read."""
    pages = [data[i : i + PAGE - 4] for i in range(0, len(data), PAGE)]
    return b"".join(page + struct.pack(">I", crc32c(page)) for page in pages if len(page) > 4)


def crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


def _files(reader, folder):
    xyz = np.round(np.random.default_rng(0).uniform(0, 9, (5, 3)), 2)
    values = dict.fromkeys(("red", "green", "blue"), np.arange(5, dtype=np.uint8))
    values |= {"intensity": np.arange(5, dtype=np.uint16), "gps_time": np.arange(5.0)}
    values["score"] = xyz[:, 0].astype(np.float32)
    clouds = PointCloud(xyz), PointCloud(xyz, values, {"ply_comments": ["a comment"]})
    if reader == "npz members":
        arrays = {"xyz.npy": xyz, "label.npy": np.arange(5), "offset.npy": xyz[0]}
        for members in (arrays, dict(zip("xyz", xyz.T, strict=True))):
            pairs = ((name.encode(), _npy(array)) for name, array in members.items())
            yield PARTS.join(part for pair in pairs for part in pair)
        return
    if reader in ("las", "laz"):
        yield from _las_files(folder, reader, xyz)
    elif reader == "npy":
        yield _npy(np.asfortranarray(xyz, ">f4"))
    for encoding in ENCODINGS.get(f".{reader}", [None]):
        for number, cloud in enumerate(clouds):
            path = folder / f"seed{number}.{reader}"
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of what a format cannot hold
                write_points(path, cloud)
            if encoding:
                save_as(path, encoding)
            yield path.read_bytes()


ENCODINGS = {".ply": ("ascii", "binary"), ".pcd": ("ascii", "binary", "binary_compressed")}


def save_as(path, encoding):
    """Write a PLY or PCD file again, in an encoding of that format."""
    if path.suffix == ".ply":
        from plyfile import PlyData

        ply = PlyData.read(str(path), mmap=False)  # as it is written over
        ply.text = encoding == "ascii"
        ply.write(str(path))
    else:
        import pypcd4

        pypcd4.PointCloud.from_path(path).save(str(path), pypcd4.Encoding(encoding))


def _las_files(folder, suffix, xyz):
    import laspy
    from laspy.vlrs.known import GeoKeyDirectoryVlr, WktCoordinateSystemVlr

    keys = GeoKeyDirectoryVlr()
    keys.parse_record_data(struct.pack("<12H", 1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 25833))
    range_of = {"scales": np.array([0.1]), "offsets": np.zeros(1)}
    for point_format in range(11):
        version = "1.4" if point_format > 5 else "1.3" if point_format > 3 else "1.2"
        header = laspy.LasHeader(version=version, point_format=point_format)
        if point_format % 3 == 0:
            header.add_extra_dim(laspy.ExtraBytesParams("score", "f4"))
            header.add_extra_dim(laspy.ExtraBytesParams("range", "u2", **range_of))
        elif point_format % 3 == 1:
            header.vlrs.append(WktCoordinateSystemVlr('PROJCS["UTM 33",GEOGCS["WGS 84"]]'))
        else:
            header.vlrs.append(keys)
        las = laspy.LasData(header)
        las.xyz = xyz
        if version == "1.4":
            las.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("user", 1, "words", b"record")])
        las.write(folder / f"seed.{suffix}")
        yield (folder / f"seed.{suffix}").read_bytes()


def _stores(folder):
    from sklearn_mcmd.tiling._cells import CellWriter
    from sklearn_mcmd.tiling._folder import write_json

    for number, store in enumerate(STORES):
        write_json(folder / f"{number}.json", store)
    writer = CellWriter(folder, 10)
    writer.add(np.zeros((1, 3)), np.zeros(1, int))
    writer.close()
    jsons = [(folder / f"{number}.json").read_bytes() for number in range(len(STORES))]
    return [*jsons, DEEP, (folder / "cells.npz").read_bytes(), _npy(np.zeros((2, 3)))]


def _npy(array):
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()

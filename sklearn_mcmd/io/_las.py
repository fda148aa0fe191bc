"""LAS and LAZ: attributes, coordinate system and integer coordinates are kept."""

import copy
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from sklearn_mcmd._errors import counted, warn_caller
from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.io._classes import LOW_NOISE
from sklearn_mcmd.io._grid import LARGEST, offset_of, scale_of
from sklearn_mcmd.io._las_structure import EVLR_HEADER, check_structure
from sklearn_mcmd.io._laz import compressed_parts, n_compressed
from sklearn_mcmd.io._point_cloud import (
    COLORS,
    PointCloud,
    PointFileError,
    fit_dtype,
    flat_columns,
)
from sklearn_mcmd.io._units import GEOGRAPHIC, PROJECTED, system_of

WRITTEN_AT_ONCE = 2_000_000  # points
FIRST_WITH_HIGH_NOISE = 6  # point format
WAVES_OF_CHANNELS = 9, 10  # point formats
USER_DEFINED = 32767  # GeoTIFF's code for a system without a code
COLORED_FORMAT = {0: 2, 1: 3, 4: 5, 6: 7, 9: 10}  # from point format to the same with colors
WIDER = {"i2", "i4", "u4", "i8", "u8"}  # dtypes that may hold colors of 8 bits
LONGEST_NAME = 32  # bytes of an extra dimension's name
EXTRA_DTYPES = {"u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8"}  # of extra dimensions

WAVEFORMS = "LASF_Spec", 65535  # user and number of the record with the samples of waveforms
# The record that says that outliers were removed.
DENOISED = {"user_id": "sklearn-mcmd", "record_id": 1, "description": "outliers removed"}


def read_las(path):
    """Read LAS, LAZ or COPC in one pass. Plain attributes are views of the raw records."""
    with open(path, "rb") as file:
        header = header_of(path, file)
        points = next(parts_of(file, header, header.point_count), b"")
    return cloud_of_points(points, header)


def parts_of(file, header, n_points):
    """The records of successive points behind a header, as bytes; of LAZ at least a chunk."""
    if header.are_points_compressed and header.point_count:
        yield from compressed_parts(file, header, n_points)
        return
    file.seek(header.offset_to_point_data)
    for start in range(0, header.point_count, n_points or 1):
        n_bytes = min(n_points, header.point_count - start) * header.point_format.size
        points = np.fromfile(file, np.uint8, n_bytes)
        if len(points) < n_bytes:
            raise PointFileError("truncated: the points end too early")
        yield points


def write_las(path, cloud, noise=None):
    """Write LAS or LAZ. Values that did not change since reading are written bit for bit."""
    with writing_parts(path) as write:
        write(cloud, noise)


@contextmanager
def writing_parts(path):
    """A function that appends the points of a cloud to a new LAS or LAZ file.

    It takes a cloud, and which of its points to mark as noise, as `write_points` does. All clouds
    must come from one file, in its order, with the same new attributes.
    """
    compressed = path.name.lower().endswith(".laz")
    laspy = import_laspy(compressed)
    channels = set[int]()
    writer: Any = None  # of laspy,
    header: Any = None  # and the header of the first cloud
    with open(path, "wb+") as file:
        sink = _Sink(file)

        def write(cloud, noise=None):
            nonlocal writer, header
            las = las_of_cloud(laspy, cloud, noise)
            if compressed and las.header.point_format.id in WAVES_OF_CHANNELS:
                channels.update(np.unique(las.scanner_channel))
                if len(channels) > 1:
                    raise PointFileError("LAZ changes waves of several channels; write .las")
            with sink.own_errors():
                if writer is None:
                    header = las.header
                    backend = laspy.LazBackend.LazrsParallel if compressed else None
                    writer = laspy.open(
                        sink, "w", header=header, laz_backend=backend, closefd=False
                    )
                if las.point_format != writer.header.point_format:
                    raise PointFileError(
                        "an attribute fits its dimension in a part of the file only"
                    )
                for start in range(0, len(las.points), WRITTEN_AT_ONCE):  # Ctrl-C ends between
                    writer.write_points(las.points[start : start + WRITTEN_AT_ONCE])

        try:
            yield write
        except BaseException:
            if writer is not None:
                with suppress(Exception):  # the first error counts
                    writer.close()
            raise
        with sink.own_errors():
            if header.version.minor >= 4 and header.evlrs is not None:
                writer.write_evlrs(header.evlrs)
            if writer.header.start_of_waveform_data_packet_record:
                _tell_waveforms(writer.header)
            writer.close()


def _tell_waveforms(header):
    """Say in a header where waveforms are now: in an extended record of LAS 1.4.

    LAS 1.3 has their samples behind the points, where laspy reads nothing: 0 is for none.
    """
    at, waveforms_at = header.start_of_first_evlr, 0
    for record in header.evlrs or []:
        if (record.user_id, record.record_id) == WAVEFORMS:
            waveforms_at = waveforms_at or at
        at += EVLR_HEADER + len(record.record_data_bytes())
    header.start_of_waveform_data_packet_record = waveforms_at
    if not waveforms_at:
        warn_caller("waveform samples behind the points of the input are not copied")


class _Sink:
    """A file for lazrs, which turns every error of Python's code into one of its own."""

    def __init__(self, file):
        self.file, self.error = file, None

    def __getattr__(self, name):
        return getattr(self.file, name)

    def write(self, data):
        try:
            return self.file.write(data)
        except BaseException as err:
            self.error = err
            raise

    @contextmanager
    def own_errors(self):
        """Raise the error of the file in the place of what lazrs made of it."""
        try:
            yield
        except BaseException as err:
            if self.error is not None and err is not self.error:
                raise self.error from err
            raise


def read_header(path):
    """The header of LAS, LAZ or COPC, and no points."""
    with open(path, "rb") as file:
        return header_of(path, file)


def header_of(path, file):
    """The header of a file that is open. Its bounds are in order, the file at any position."""
    laspy = import_laspy(path.name.lower().endswith(".laz"))
    n_points, n_behind = check_structure(file)
    file.seek(0)
    header = laspy.LasHeader.read_from(file, read_evlrs=True)
    if n_points != header.point_count:
        header.point_count = n_points
        warn_caller(f"{path}: its header counts 0 points, but {n_points:,} where LAS 1.2 does")
    if header.are_points_compressed and n_points:
        header.point_count = n_compressed(file, header)
        if header.point_count < n_points:
            counted_more = f"of the {n_points:,} points that its header counts"
            warn_caller(f"{path}: holds {header.point_count:,} {counted_more}")
    for record in header.vlrs.get("ExtraBytesVlr"):  # laspy forgets which value means no data
        no_data = {e.format_name(): e.no_data for e in record.extra_bytes_structs if e.data_type}
        header.point_format.dimensions = [
            dimension._replace(no_data=no_data.get(dimension.name))
            for dimension in header.point_format.dimensions
        ]
    if n_behind:
        warn_caller(
            f"{path}: holds {counted(n_behind, 'record')} more than its header counts: not read"
        )
    if header.version.minor < 2:
        header.global_encoding = type(header.global_encoding)()  # these bytes meant nothing then
    header.mins, header.maxs = np.sort([header.mins, header.maxs], axis=0)
    return header


def coordinate_system(header):
    """Name or EPSG code of the coordinate system of a LAS header, or None."""
    wkts, keys = system_of(header)
    for wkt in wkts:
        if wkt.count('"') >= 2:  # WKT begins with its kind and its name
            return wkt.split('"')[1]
    code = keys.get(PROJECTED, keys.get(GEOGRAPHIC))
    if code is None:
        return None
    return "user-defined" if code == USER_DEFINED else f"EPSG:{code}"


def is_denoised(header):
    """Whether the file of a LAS header is what `mcmd denoise` has left."""
    key = DENOISED["user_id"], DENOISED["record_id"]
    return any((record.user_id, record.record_id) == key for record in header.vlrs)


def cloud_of_points(points, header):
    """The cloud of some of a file's points, given as bytes, of which attributes are views."""
    laspy = import_laspy(compressed=False)
    records = laspy.PackedPointRecord.from_buffer(points, header.point_format).array
    records = laspy.ScaleAwarePointRecord(
        records, header.point_format, header.scales, header.offsets
    )
    las = laspy.LasData(header, records)
    names = las.point_format.dimension_names
    attributes = {name: np.asarray(las[name]) for name in names if name not in ("X", "Y", "Z")}
    metadata = {"las_header": header, "las_points": las.points.array}
    if is_denoised(header):
        metadata["denoised"] = True
    return PointCloud(_coordinates(las.points.array, header), attributes, metadata)


def las_of_cloud(laspy, cloud, noise=None):
    """What is to be written: laspy's header and points, with all attributes."""
    if "las_points" in cloud.metadata:
        header = copy.deepcopy(cloud.metadata["las_header"])
        if header.version.minor < 2:  # laspy does not write older ones, and they hold the same
            header.version = type(header.version)(1, 2)
        forget_copc(header)
        records = laspy.ScaleAwarePointRecord(
            cloud.metadata["las_points"].copy(), header.point_format, header.scales, header.offsets
        )
    else:
        header = _new_header(laspy, cloud)
        records = laspy.ScaleAwarePointRecord.zeros(len(cloud), header=header)
    if cloud.metadata.get("denoised") and not is_denoised(header):
        header.vlrs.append(laspy.VLR(**DENOISED))
    las = laspy.LasData(header, records)
    las, attributes = _with_colors(laspy, las, cloud.attributes, "las_points" in cloud.metadata)
    _store_coordinates(las, cloud.xyz)
    _store_attributes(laspy, las, attributes)
    if noise is not None:
        if noise.dtype == bool or las.header.point_format.id < FIRST_WITH_HIGH_NOISE:
            noise = np.where(noise, LOW_NOISE, 0)
        las.classification = np.where(noise, noise, np.array(las.classification))
    for record in las.header.vlrs.get("ExtraBytesVlr"):
        for described in record.extra_bytes_structs:
            # laspy has the range of the first points of parts. Of type 0, options are another word.
            if described.data_type != 0:
                described.options &= ~(described.MIN_BIT_MASK | described.MAX_BIT_MASK)
    return las


def _with_colors(laspy, las, attributes, from_las):
    """A point format with colors, and colors of 8 bits in the 16 of LAS: 255 becomes 65535.

    Integers up to 255 have 8 bits, unless they are uint16 or LAS had them.
    """
    if not set(COLORS) <= attributes.keys():
        return las, attributes
    names = set(las.point_format.dimension_names)
    wanted = COLORED_FORMAT.get(las.header.point_format.id)
    if wanted is not None and not names & set(COLORS):
        las = laspy.convert(las, point_format_id=wanted)
    colors = [attributes[color] for color in COLORS]
    wider = {v.dtype.str[1:] for v in colors} - {"u1"}
    if not wider or not (
        from_las or wider - WIDER or any(v.min() < 0 or v.max() > 255 for v in colors)
    ):
        # 65535 is 255 * 257, so that the high byte and the low one are the 8 bits.
        wide = {color: v.astype(np.uint16) * 257 for color, v in zip(COLORS, colors, strict=True)}
        attributes = {**attributes, **wide}
    return las, attributes


def import_laspy(compressed):
    laspy = import_extra("laspy", "las", "LAS")
    if compressed:
        import_extra("lazrs", "las", "LAZ")
    return laspy


def forget_copc(header):
    """Remove the records of a COPC file's octree, which no longer describes the points."""
    for records in (header.vlrs, header.evlrs or []):
        for record in [r for r in records if r.user_id == "copc"]:
            records.remove(record)


def _coordinates(records, header):
    """Coordinates (n, 3): integers times scale plus offset, rounded in this order as in laspy."""
    xyz = np.empty((len(records), 3))
    for i, axis in enumerate("XYZ"):
        np.multiply(records[axis], header.scales[i], out=xyz[:, i])
        xyz[:, i] += header.offsets[i]
    return xyz


def _store_coordinates(las, xyz):
    """Store coordinates as integers; an axis without changes keeps its own."""
    header, records = las.header, las.points.array
    moved = ~(_coordinates(records, header) == xyz).all(axis=0)
    scales, offsets = header.scales.copy(), header.offsets.copy()
    for i in np.flatnonzero(moved):
        steps = np.rint((xyz[:, i] - offsets[i]) / scales[i])
        if np.abs(steps).max() > LARGEST:
            low, high = xyz[:, i].min(), xyz[:, i].max()
            if not (high - low) / 2 <= (LARGEST - 1) * scales[i]:  # about the middle
                scales[i] = scale_of(xyz, [i])
            offsets[i] = offset_of(low, high, scales[i])
            steps = np.rint((xyz[:, i] - offsets[i]) / scales[i])
        records["XYZ"[i]] = steps.astype(np.int32)
    header.scales, header.offsets = scales, offsets
    las.points.scales, las.points.offsets = scales, offsets


def _new_header(laspy, cloud):
    """A LAS 1.4 header, without colors, on a grid that fits the coordinates."""
    header = laspy.LasHeader(version="1.4", point_format=6)
    low, high = cloud.xyz.min(axis=0), cloud.xyz.max(axis=0)
    scale = scale_of(cloud.xyz)
    header.scales = np.full(3, scale)
    header.offsets = np.array([offset_of(a, b, scale) for a, b in zip(low, high, strict=True)])
    return header


def _store_attributes(laspy, las, attributes):
    """Fill the dimensions that hold the values exactly; all other values get extra dimensions."""
    standard = set(las.point_format.standard_dimension_names)
    extra = set(las.point_format.extra_dimension_names)
    stored = {n for n, v in attributes.items() if n in standard | extra and _assigned(las, n, v)}
    others = {name: values for name, values in attributes.items() if name not in stored}
    new: dict[str, np.ndarray] = {}
    for name, column in flat_columns(others).items():
        if name in standard:
            warn_caller(
                f"{name!r} does not fit the LAS dimension of that name; it is stored as the "
                f"extra dimension {name + '_value'!r}"
            )
            name += "_value"
        if name in new or name in stored:
            raise PointFileError(f"two attributes would both be written as {name!r}")
        if len(name.encode()) > LONGEST_NAME:
            raise PointFileError(f"rename {name!r}: it is longer than {LONGEST_NAME} bytes")
        new[name] = fit_dtype(name, column, EXTRA_DTYPES, "LAS")
    if replaced := extra & (others.keys() | new.keys()):
        las.remove_extra_dims(list(replaced))
    if new:
        las.add_extra_dims([laspy.ExtraBytesParams(n, column.dtype) for n, column in new.items()])
    for name, column in new.items():
        las[name] = column


def _assigned(las, name, values):
    """Put values into an existing dimension if it holds them exactly, else leave it unchanged."""
    stored = np.array(las[name])
    if values.shape != stored.shape or values.dtype.kind not in "biuf":
        return False
    if _same(stored, values):
        return True  # nothing is written, so a scaled dimension keeps its integers
    # laspy refuses values that a bit field cannot hold.
    with suppress(OverflowError, ValueError), np.errstate(invalid="ignore", over="ignore"):
        las[name] = values.astype(stored.dtype)
        if _same(np.asarray(las[name]).astype(values.dtype), values):
            return True
    las[name] = stored
    return False


def _same(stored, values):
    return np.array_equal(stored, values, equal_nan=stored.dtype.kind == values.dtype.kind == "f")

"""The position of the waveform samples in a LAS file, to which its wave packets point."""

import struct

from sklearn_mcmd._errors import warn_caller

__all__ = ["place_waveforms"]

START_FIELD = 227  # of the header, from LAS 1.3 on
WAVEFORM_RECORD = 65535


def place_waveforms(path, header):
    """Write the new position of the waveforms into a file; laspy repeats the old position.

    In LAS 1.4 the extended record that holds them is copied. In LAS 1.3 it is behind the points,
    where laspy reads nothing. Then position 0 says that there is none.
    """
    if header.version.minor < 3 or not header.start_of_waveform_data_packet_record:
        return
    with open(path, "rb+") as file:
        start = _find(file) if header.version.minor >= 4 else 0
        file.seek(START_FIELD)
        file.write(struct.pack("<Q", start))
    if not start:
        warn_caller(
            "the samples of waveforms that the input holds behind its points are not copied; "
            "what the points say of them is."
        )


def _find(file):
    """The position of the record of waveforms, or 0 if there is none."""
    file.seek(235)
    position, n_records = struct.unpack("<QI", file.read(12))
    for _ in range(n_records):
        file.seek(position)
        user, record, length = struct.unpack("<2x16sHQ", file.read(28))
        if user.rstrip(b"\0") == b"LASF_Spec" and record == WAVEFORM_RECORD:
            return position
        position += 60 + length
    return 0

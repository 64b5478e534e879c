"""The sizes that a file of arrays claims, compared before anything is unpacked: a small file may hold very much."""

import math
import zipfile
from pathlib import Path

import numpy as np

PLAUSIBLE = 200  # times that readings shrink when they are packed; nan and zeros shrink a thousandfold
HARMLESS = 2**28  # bytes that are unpacked whatever the ratio


def demand_sizes(path: Path) -> None:
    """Refuse a zip of arrays that would unpack to far more than readings do, or whose arrays lie about their sizes.

    Raises:
        ValueError: says how much it would be.
        zipfile.BadZipFile: it is not a zip.

    """
    size = path.stat().st_size
    with zipfile.ZipFile(path) as file:
        members = file.infolist()
        unpacked = sum(member.file_size for member in members)
        if unpacked > max(HARMLESS, PLAUSIBLE * size):
            raise ValueError(f"{size} bytes would unpack to {unpacked}, which no stream does")
        for member in members:
            if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError(f"{member.filename} is packed in a way that cooploc does not use")
            with file.open(member) as array:
                version = np.lib.format.read_magic(array)
                read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                shape, _, dtype = read(array)
                if array.tell() + math.prod(shape) * dtype.itemsize != member.file_size:
                    raise ValueError(f"{member.filename} does not have the size that its shape {shape} takes")

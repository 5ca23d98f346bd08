"""How an HDF5 file is recognized, and what one of swashtwin calls itself."""

from pathlib import Path

SIGNATURE = b"\x89HDF\r\n\x1a\n"
"""Bytes that every HDF5 file begins with, or holds at 512 or a doubling of it."""
KIND = "swashtwin recording "
"""What every version of a file of one recording begins its name with."""
FORMAT = f"{KIND}3"
"""What a file of one recording calls itself."""
STORE_KIND = "swashtwin store "
"""What every version of a file of many recordings begins its name with."""
STORE_FORMAT = f"{STORE_KIND}2"
"""What a file of many recordings calls itself."""
CONDITION = ("speed", "discharge_pressure", "suction_pressure", "case_pressure", "oil_temperature")
"""Fields of an operating condition."""


def is_hdf5(path: Path) -> bool:
    """Whether a file begins as an HDF5 file, after a block of another program's or without one."""
    with path.open("rb") as file:
        head = file.read(8192)
    return any(head[at : at + 8] == SIGNATURE for at in (0, 512, 1024, 2048, 4096))

"""Packed records for engines: a header of 64 bytes, then single-precision numbers."""

import struct
import zlib
from pathlib import Path

import numpy as np

from camojab._files import replacing

from ..tables import QualityTables
from ._records import BASES, Records, records


HEADER_BYTES = 64
_MAGIC, _VERSION = b"ALSARRTB", 1
_HEADER = struct.Struct("<8s3I2H3I7f")
_CHECKSUM_AT = 32


def write_binary(path: str | Path, tables: QualityTables | Records) -> None:
    """Write tables as one block of memory that an engine can map, little-endian.

    The header has 64 bytes: at 0 `ALSARRTB`; then as uint32 at 8 the version (1), at 12
    the number of textures and at 16 that of mip levels (from 0); as uint16 at 20 that
    of rates (7 in the order of `alsarr.RATES`, or 3, the sides 4, 2 and 1 of separable
    tables) and at 22 that of directions of motion (x and y, or one for both); as uint32
    at 24 the bytes from one record to the next, at 28 the basis (see below) and at 32
    the CRC-32 of header and records with this number 0; then as float32 at 36 the
    shortest travel that counts [deg] (0 unless the basis is `tensor`) and at 40 the
    lowest and highest velocity [deg/s], refresh rate [Hz] and log10 luminance
    [log10(cd/m^2)].

    A record is the coefficients of one polynomial as float32, with zeros up to a
    multiple of 16 bytes: 12 numbers for the ten of Eq. 31. Its index is
    `(texture * mips + mip) * rates + rate`; all of direction x come before those of y.

    The basis is 1 for `eq31`, 2 for `eq31-log-travel` and 3 for `tensor`, whose three
    degrees are the higher bytes, `3 | d0 << 8 | d1 << 16 | d2 << 24`.

    Written whole or not at all.

    **Raises:** `ValueError` for a mip level that is no whole number, a number that is
    not finite in single precision, or a degree above 255.
    """
    found = tables if isinstance(tables, Records) else records(tables)
    data = packed(found)
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def read_binary(path: str | Path) -> Records:
    """Read what `write_binary` wrote.

    **Raises:** `ValueError` naming the file and what is wrong with it: foreign, of
    another version, truncated, too long, altered, or with a number that is not finite.
    `FileNotFoundError` if there is none.
    """
    data = Path(path).read_bytes()
    if data[: len(_MAGIC)] != _MAGIC:
        raise ValueError(f"{path}: must begin with {_MAGIC.decode()}.")
    if len(data) < HEADER_BYTES:
        raise ValueError(
            f"{path}: must have {HEADER_BYTES} bytes of header, got {len(data)}."
        )
    header = _HEADER.unpack_from(data)
    _, version, *counts, stride, basis, checksum, travel = header[:10]
    textures, mips, rates, directions = counts
    if version != _VERSION:
        raise ValueError(f"{path}: version must be {_VERSION}, got {version}.")
    size = HEADER_BYTES + directions * textures * mips * rates * stride
    if len(data) != size:
        raise ValueError(f"{path}: must have {size} bytes, got {len(data)}.")
    if _checksum(data) != checksum:
        raise ValueError(f"{path}: must have the checksum of what it holds.")
    name, degrees = _basis(basis, path)
    coefficients = int(np.prod(np.add(degrees, 1))) if name == "tensor" else 10
    if stride != -(-coefficients // 4) * 16:
        raise ValueError(
            f"{path}: the stride must be {-(-coefficients // 4) * 16} bytes for "
            f"{coefficients} coefficients, got {stride}."
        )
    numbers = np.frombuffer(data, "<f4", offset=HEADER_BYTES).astype(np.float32)
    numbers = numbers.reshape(directions, textures, mips, rates, stride // 4)
    domain = np.array(header[10:], np.float32).reshape(3, 2)
    try:
        return Records(numbers[..., :coefficients], name, degrees, domain, travel)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def packed(found: Records) -> bytes:
    """The bytes of `write_binary`."""
    if max(found.degrees) > 255:
        raise ValueError(f"`degrees` must be at most 255, got {found.degrees}.")
    directions, textures, mips, rates, _ = found.coefficients.shape
    basis = BASES[found.basis]
    for byte, degree in enumerate(found.degrees, start=1):
        basis |= degree << 8 * byte
    counts = (_VERSION, textures, mips, rates, directions, 4 * found.floats, basis)
    numbers = (found.shortest_travel, *found.domain.ravel())
    header = _HEADER.pack(_MAGIC, *counts, 0, *numbers)
    data = bytearray(header + found.padded().astype("<f4").tobytes())
    struct.pack_into("<I", data, _CHECKSUM_AT, _checksum(data))
    return bytes(data)


def _checksum(data: bytes | bytearray) -> int:
    seen = zlib.crc32(data[:_CHECKSUM_AT])
    seen = zlib.crc32(bytes(4), seen)
    return zlib.crc32(memoryview(data)[_CHECKSUM_AT + 4 :], seen)


def _basis(number: int, path: str | Path) -> tuple[str, tuple[int, int, int]]:
    names = {value: name for name, value in BASES.items()}
    name = names.get(number & 255)
    degrees = (number >> 8 & 255, number >> 16 & 255, number >> 24)
    if name is None or (name != "tensor" and any(degrees)):
        raise ValueError(f"{path}: the basis must be 1, 2 or 3, got {number:#x}.")
    return name, degrees

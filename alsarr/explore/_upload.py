"""The bytes of an image that somebody chose -> relative luminance."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from camojab import luminance


if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile


MOST_BYTES = 16 * 2**20
"""Largest file that is taken. [bytes]"""

MOST_PIXELS = 8192
"""Largest width and height of an image. [px]"""

LEAST_PIXELS = 16
"""Smallest width and height of an image, those of a tile. [px]"""

# Of an image no more is looked at, as in `Spectrum.from_texture`.
_SIZE = 512

_SIGNATURES = {
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"\xff\xd8\xff": "JPEG",
    b"GIF8": "GIF",
    b"BM": "BMP",
    b"RIFF": "WEBP",
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
}

# Modes of Pillow, and the one that has their light: grey, or red, green and blue.
_MODES = {
    "1": "L",
    "L": "L",
    "LA": "L",
    "I;16": "I;16",
    "I;16B": "I;16",
    "P": "RGB",
    "PA": "RGB",
    "RGB": "RGB",
    "RGBA": "RGB",
    "RGBX": "RGB",
}


def read_image(content: bytes) -> np.ndarray:
    """The top left 512 x 512 pixels of an image file, grey or red, green and blue.

    PNG, JPEG, WebP, BMP, TIFF and GIF are known by how they begin, not by a name. The
    size is read from the header, and only then is the rest decoded. Transparency is
    left out. Nothing is written anywhere.

    **Returns:** code values as stored, [height, width] or [height, width, 3], integers
    of 8 or 16 bits (16 of grey images alone; Pillow reads colour in 8).

    **Raises:** `ValueError` for what is no image, is empty, of more than 16 MiB, more
    than 8192 px or less than 16 px wide or high, animated, of other colours than grey
    and RGB, or damaged.
    """
    check_bytes(len(content))
    image = _opened(content)
    _check_size(image.size)
    kind = str(image.format)
    with _reading(kind):
        frames = getattr(image, "n_frames", 1)
    if frames > 1:
        raise ValueError(f"`image` must be a still image, got {frames} frames.")
    if image.mode not in _MODES:
        raise ValueError(
            f"`image` must be grey or of red, green and blue, got {image.mode}."
        )
    with _reading(kind):
        part = image.crop((0, 0, min(_SIZE, image.width), min(_SIZE, image.height)))
        mode = _MODES[part.mode]
        pixels = np.asarray(part if mode == "I;16" else part.convert(mode))
    return pixels.astype(np.uint16 if mode == "I;16" else np.uint8)


def texture(pixels: np.ndarray, encoding: str) -> Float[np.ndarray, "rows columns"]:
    """Relative luminance of what `read_image` returned. `encoding` as `luminance`."""
    return luminance(pixels, encoding=encoding)


def check_bytes(size: int) -> None:
    """**Raises:** `ValueError` for an empty file, and one of more than 16 MiB."""
    if size == 0:
        raise ValueError("`image` must have content, got 0 bytes.")
    if size > MOST_BYTES:
        raise ValueError(
            f"`image` must be of at most {MOST_BYTES / 2**20:.0f} MiB, got "
            f"{size / 2**20:.1f} MiB."
        )


def _opened(content: bytes) -> "ImageFile":
    """With its header read and nothing decoded.

    The classes of the formats are called themselves: `PIL.Image.open` refuses very
    large images without telling their size, and tries formats that run programs.
    """
    from PIL import (
        BmpImagePlugin,
        GifImagePlugin,
        JpegImagePlugin,
        PngImagePlugin,
        TiffImagePlugin,
        WebPImagePlugin,
    )

    readers = {
        "PNG": PngImagePlugin.PngImageFile,
        "JPEG": JpegImagePlugin.JpegImageFile,
        "GIF": GifImagePlugin.GifImageFile,
        "BMP": BmpImagePlugin.BmpImageFile,
        "WEBP": WebPImagePlugin.WebPImageFile,
        "TIFF": TiffImagePlugin.TiffImageFile,
    }
    kind = next((k for s, k in _SIGNATURES.items() if content.startswith(s)), None)
    if kind is None:
        raise ValueError(
            "`image` must be a PNG, JPEG, WebP, BMP, TIFF or GIF, got something else."
        )
    with _reading(kind):
        return readers[kind](io.BytesIO(content))


@contextmanager
def _reading(kind: str) -> Iterator[None]:
    """Whatever a decoder says of a file that it cannot read, in a sentence."""
    try:
        yield
    # Each of them has errors of its own.
    except Exception as error:
        raise ValueError(
            f"`image` must be readable to its end, got a damaged {kind}."
        ) from error


def _check_size(size: tuple[int, int]) -> None:
    width, height = size
    if max(size) > MOST_PIXELS:
        raise ValueError(
            f"`image` must be at most {MOST_PIXELS} px wide and high, got {width} x "
            f"{height} px."
        )
    if min(size) < LEAST_PIXELS:
        raise ValueError(
            f"`image` must be at least {LEAST_PIXELS} px wide and high, got {width} x "
            f"{height} px."
        )

"""What becomes of the bytes that somebody chooses in the explorer."""

import io
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from PIL import Image

from alsarr.explore._upload import check_bytes, read_image, texture
from camojab import luminance


RANDOM = np.random.default_rng(7)
COLOUR = RANDOM.integers(0, 256, (30, 40, 3), np.uint8)


def file_of(pixels, kind="PNG", mode=None, **options):
    image = Image.fromarray(pixels)
    if mode is not None:
        image = image.convert(mode)
    stream = io.BytesIO()
    image.save(stream, kind, **options)
    return stream.getvalue()


def header_alone(width, height):
    """A PNG that says how large it is and holds nothing else."""

    def chunk(name, data):
        check = struct.pack(">I", zlib.crc32(name + data))
        return struct.pack(">I", len(data)) + name + data + check

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IEND", b"")


def animation(kind):
    frames = [Image.fromarray(COLOUR), Image.fromarray(255 - COLOUR)]
    stream = io.BytesIO()
    frames[0].save(stream, kind, save_all=True, append_images=frames[1:])
    return stream.getvalue()


@pytest.mark.parametrize("kind", ["PNG", "BMP", "TIFF"])
def test_pixels_come_back_as_stored(kind):
    np.testing.assert_array_equal(read_image(file_of(COLOUR, kind)), COLOUR)


@pytest.mark.parametrize("kind", ["JPEG", "WEBP"])
def test_lossy_files_come_back_nearly(kind):
    smooth = np.full((32, 48, 3), (10, 120, 200), np.uint8)
    found = read_image(file_of(smooth, kind, quality=95)).astype(int)
    assert np.abs(found - smooth).max() <= 4


def test_only_the_top_left_is_kept():
    large = RANDOM.integers(0, 256, (530, 700), np.uint8)
    np.testing.assert_array_equal(read_image(file_of(large)), large[:512, :512])


def test_sixteen_bits_of_grey_are_kept():
    deep = RANDOM.integers(0, 2**16, (20, 24), np.uint16)
    found = read_image(file_of(deep))
    assert found.dtype == np.uint16
    np.testing.assert_array_equal(found, deep)
    np.testing.assert_allclose(texture(found, "linear"), deep / 65535)


def test_transparency_is_left_out():
    alpha = RANDOM.integers(0, 256, (30, 40, 1), np.uint8)
    whole = np.concatenate([COLOUR, alpha], axis=-1)
    np.testing.assert_array_equal(read_image(file_of(whole)), COLOUR)
    grey = np.concatenate([COLOUR[..., :1], alpha], axis=-1)
    np.testing.assert_array_equal(read_image(file_of(grey)), COLOUR[..., 0])


def test_palettes_and_bits_are_read():
    two = np.where(COLOUR[..., :1] > 127, COLOUR[:1, :1], 255 - COLOUR[:1, :1])
    found = read_image(file_of(two.astype(np.uint8), mode="P"))
    assert found.shape == (30, 40, 3)
    bits = COLOUR[..., 0] > 127
    np.testing.assert_array_equal(read_image(file_of(bits)), np.where(bits, 255, 0))


@pytest.mark.parametrize("encoding", ["sRGB", "linear"])
def test_light_is_that_of_the_package(encoding):
    expected = luminance(COLOUR, encoding=encoding)
    np.testing.assert_array_equal(texture(COLOUR, encoding), expected)


BAD = {
    "empty": (b"", "must have content, got 0 bytes."),
    "text": (
        b"velocity,quality\n1,2\n",
        "must be a PNG, JPEG, WebP, BMP, TIFF or GIF, got something else.",
    ),
    "postscript": (
        b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n",
        "must be a PNG, JPEG, WebP, BMP, TIFF or GIF, got something else.",
    ),
    "signature alone": (b"\x89PNG\r\n\x1a\n", "got a damaged PNG."),
    "half": (file_of(COLOUR)[:1500], "got a damaged PNG."),
    "half of a JPEG": (file_of(COLOUR, "JPEG")[:700], "got a damaged JPEG."),
    "wide": (
        header_alone(20_000, 20),
        "must be at most 8192 px wide and high, got 20000 x 20 px.",
    ),
    # Of so many pixels Pillow warns, and of the next it refuses to say the size.
    "high": (header_alone(9_000, 10_000), "got 9000 x 10000 px."),
    "bomb": (header_alone(60_000, 60_000), "got 60000 x 60000 px."),
    "single": (
        file_of(np.zeros((1, 1), np.uint8)),
        "must be at least 16 px wide and high, got 1 x 1 px.",
    ),
    "GIF": (animation("GIF"), "must be a still image, got 2 frames."),
    "APNG": (animation("PNG"), "must be a still image, got 2 frames."),
    "WebP": (animation("WEBP"), "must be a still image, got 2 frames."),
    "print": (
        file_of(COLOUR, "JPEG", "CMYK"),
        "must be grey or of red, green and blue, got CMYK.",
    ),
    "real": (
        file_of(np.full((20, 20), 0.5, np.float32), "TIFF"),
        "must be grey or of red, green and blue, got F.",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files_get_a_sentence(case):
    content, sentence = BAD[case]
    with pytest.raises(ValueError) as raised:
        read_image(content)
    text = str(raised.value)
    assert text.startswith("`image` must be ") or case == "empty"
    assert text.endswith(sentence) and "\n" not in text


def test_large_files_are_refused_by_their_size():
    check_bytes(16 * 2**20)
    sentence = r"^`image` must be of at most 16 MiB, got 30.0 MiB.$"
    with pytest.raises(ValueError, match=sentence):
        check_bytes(30 * 2**20)


WHOLE = {kind: file_of(COLOUR, kind) for kind in ("PNG", "JPEG", "GIF", "TIFF", "BMP")}


@settings(deadline=None, max_examples=60)
@given(
    kind=st.sampled_from(sorted(WHOLE)),
    place=st.floats(0, 1),
    change=st.binary(min_size=1, max_size=8),
)
def test_damage_is_a_sentence_or_does_no_harm(kind, place, change):
    content = bytearray(WHOLE[kind])
    start = int(place * (len(content) - 1))
    content[start : start + len(change)] = change
    try:
        pixels = read_image(bytes(content))
    except ValueError as error:
        assert str(error).startswith("`image` must be ")
    else:
        assert pixels.dtype in (np.uint8, np.uint16) and min(pixels.shape[:2]) >= 16

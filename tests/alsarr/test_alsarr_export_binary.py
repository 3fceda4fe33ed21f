"""Packed records: what is where, and that nothing damaged is read."""

import json
import struct
import zlib

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr import RATES
from alsarr.export import (
    read_binary,
    read_rgba32f,
    Records,
    records,
    texels,
    write_binary,
    write_rgba32f,
)
from alsarr.tables import (
    Certificate,
    Conditions,
    Domain,
    Eq31,
    QualityTables,
    TensorPolynomial,
)


DOMAIN = np.array([[0, 50], [30, 120], [-1, 2.5]], np.float32)
SIDES = ("4", "2", "1")


def drawn(directions=2, textures=2, mips=3, rates=7, degrees=None, seed=0):
    number = 10 if degrees is None else int(np.prod(np.add(degrees, 1)))
    shape = (directions, textures, mips, rates, number)
    coefficients = np.random.default_rng(seed).normal(size=shape)
    return Records(
        coefficients=coefficients.astype(np.float32),
        basis="eq31" if degrees is None else "tensor",
        degrees=degrees or (0, 0, 0),
        domain=DOMAIN,
        shortest_travel=0.0 if degrees is None else 0.0078125,
    )


def same(a, b):
    np.testing.assert_array_equal(a.coefficients, b.coefficients)
    np.testing.assert_array_equal(a.domain, b.domain)
    assert (a.basis, a.degrees, a.rates) == (b.basis, b.degrees, b.rates)
    assert a.shortest_travel == b.shortest_travel


@settings(deadline=None, max_examples=20)
@given(
    st.integers(1, 2),
    st.integers(1, 3),
    st.integers(1, 3),
    st.sampled_from([3, 7]),
    st.one_of(st.none(), st.tuples(*[st.integers(0, 4)] * 3)),
    st.integers(0, 2**32 - 1),
)
def test_binary_is_read_back(
    tmp_path_factory, directions, textures, mips, rates, degrees, seed
):
    path = tmp_path_factory.mktemp("tables") / "tables.bin"
    found = drawn(directions, textures, mips, rates, degrees, seed)
    write_binary(path, found)
    same(read_binary(path), found)
    assert [p.name for p in path.parent.iterdir()] == ["tables.bin"]


def test_header_is_as_documented(tmp_path):
    path = tmp_path / "tables.bin"
    found = drawn(directions=2, textures=4, mips=3, degrees=(5, 2, 3))
    write_binary(path, found)
    data = path.read_bytes()
    assert data[:8] == b"ALSARRTB"
    assert struct.unpack_from("<3I", data, 8) == (1, 4, 3)
    assert struct.unpack_from("<2H", data, 20) == (7, 2)
    assert struct.unpack_from("<2I", data, 24) == (
        72 * 4,
        3 | 5 << 8 | 2 << 16 | 3 << 24,
    )
    blank = data[:32] + bytes(4) + data[36:]
    assert struct.unpack_from("<I", data, 32) == (zlib.crc32(blank),)
    numbers = struct.unpack_from("<7f", data, 36)
    assert numbers == (0.0078125, 0, 50, 30, 120, -1, 2.5)
    assert len(data) == 64 + 2 * 4 * 3 * 7 * 72 * 4


def test_a_record_is_where_its_index_says(tmp_path):
    path = tmp_path / "tables.bin"
    found = drawn(directions=2, textures=2, mips=3)
    write_binary(path, found)
    data = path.read_bytes()
    direction, texture, mip, rate = 1, 0, 2, 5
    index = (texture * 3 + mip) * 7 + rate + direction * 2 * 3 * 7
    record = np.frombuffer(data, "<f4", 12, 64 + 48 * index)
    expected = found.coefficients[direction, texture, mip, rate]
    np.testing.assert_array_equal(record, [*expected, 0, 0])


def checked(data):
    """Bytes with the checksum that they should have."""
    blank = data[:32] + bytes(4) + data[36:]
    return data[:32] + struct.pack("<I", zlib.crc32(blank)) + data[36:]


def put(form, at, *values):
    def damage(data):
        data = bytearray(data)
        struct.pack_into(form, data, at, *values)
        return checked(bytes(data))

    return damage


@pytest.mark.parametrize(
    "damage, message",
    [
        (lambda data: b"", "must begin with ALSARRTB"),
        (lambda data: b"x" + data[1:], "must begin with ALSARRTB"),
        (lambda data: data[:63], "must have 64 bytes of header, got 63"),
        (lambda data: data[:-1], "must have 4096 bytes, got 4095"),
        (lambda data: data[:64], "must have 4096 bytes, got 64"),
        (lambda data: data + b"x", "must have 4096 bytes, got 4097"),
        (put("<I", 8, 2), "version must be 1, got 2"),
        (put("<I", 12, 2**32 - 1), "must have .* bytes, got 4096"),
        (put("<2H", 20, 14, 1), "`coefficients` must be of one or two directions"),
        (put("<I", 28, 4), "the basis must be 1, 2 or 3, got 0x4"),
        (put("<I", 28, 1 | 1 << 8), "the basis must be 1, 2 or 3, got 0x101"),
        (put("<I", 28, 3 | 1 << 8), "the stride must be 16 bytes for 2 coeff.* got 48"),
        (put("<f", 36 + 4, np.nan), "`domain` must be"),
        (put("<f", 36 + 4, 51), "`domain` must be"),
        (put("<f", 64 + 400, np.nan), "`coefficients` must be finite"),
        (put("<f", 64 + 400, np.inf), "`coefficients` must be finite"),
        (put("<2I", 12, 0, 3), "must have 64 bytes, got 4096"),
    ],
)
def test_damaged_binary_is_refused(tmp_path, damage, message):
    path = tmp_path / "tables.bin"
    write_binary(path, drawn())
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(ValueError, match=f"tables.bin: {message}"):
        read_binary(path)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 4095), st.integers(1, 255))
def test_no_altered_byte_goes_unnoticed(tmp_path_factory, at, change):
    path = tmp_path_factory.mktemp("tables") / "tables.bin"
    write_binary(path, drawn())
    data = bytearray(path.read_bytes())
    data[at] ^= change
    path.write_bytes(data)
    with pytest.raises(ValueError, match="tables.bin: "):
        read_binary(path)


def test_no_tables_leave_no_file(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_binary(tmp_path / "tables.bin")
    with pytest.raises(ValueError, match="`degrees` must be at most 255"):
        write_binary(tmp_path / "tables.bin", drawn(1, 1, 1, 3, (256, 0, 0)))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"basis": "other"}, "`basis` must be one of eq31, eq31-log-travel, tensor"),
        ({"basis": "tensor"}, "`coefficients` must be 1 a polynomial .*, got 10"),
        (
            {"basis": "tensor", "degrees": (4, 1, 0), "shortest_travel": 0.0},
            "`shortest_travel` must be > 0 deg, got 0",
        ),
        ({"domain": DOMAIN[:, ::-1].copy()}, "`domain` must be"),
        ({"domain": DOMAIN * np.float32(20)}, "`domain` must be"),
        ({"domain": DOMAIN - np.float32(30)}, "`domain` must be"),
        ({"coefficients": np.zeros((1, 1, 1, 4, 10), np.float32)}, "3 or 7 rates"),
        ({"coefficients": np.zeros((3, 1, 1, 7, 10), np.float32)}, "one or two dir"),
        ({"coefficients": np.zeros((1, 0, 1, 7, 10), np.float32)}, "some textures"),
    ],
)
def test_records_that_contradict_themselves(changes, message):
    good = drawn()
    fields = {
        "coefficients": good.coefficients,
        "basis": "eq31",
        "degrees": (0, 0, 0),
        "domain": DOMAIN,
    }
    with pytest.raises(ValueError, match=message):
        Records(**fields | changes)


def built(coefficients, rates, basis, mip_levels=(0, 2)):
    """Tables of one texture, of which there is an entry for each level."""
    entries = coefficients.shape[0]
    errors = np.zeros(coefficients.shape[:3])
    zero = jnp.zeros(1)
    return QualityTables(
        coefficients=coefficients,
        entry=np.arange(entries)[None],
        occurs=np.ones((1, entries), bool),
        constant=np.zeros(entries, bool),
        mip_levels=mip_levels,
        domain=Domain(),
        certificate=Certificate(
            largest=errors,
            percentile_99=errors,
            median=errors,
            overall=np.zeros(3),
            sample=Conditions(zero, zero, zero),
        ),
        basis=basis,
        rates=rates,
        texture_names=("one",),
        model="a model",
        relative_to=None,
    )


def test_records_of_tables():
    rng = np.random.default_rng(0)
    coefficients = rng.normal(size=(2, 7, 2, 10)).astype(np.float32)
    found = records(built(coefficients, RATES.names, Eq31()))
    # Level 1 is as near to 0 as to 2, and the finer is taken.
    expected = np.moveaxis(coefficients[[0, 0, 1]], 2, 0)[:, None]
    np.testing.assert_array_equal(found.coefficients, expected)
    np.testing.assert_array_equal(found.domain, DOMAIN)
    assert (found.basis, found.degrees, found.relative_to) == ("eq31", (0, 0, 0), "")
    assert found.model == "a model" and found.rates == RATES.names


def test_rates_that_tables_lack_are_the_nearest_finer():
    coefficients = np.arange(3.0)[None, :, None, None] * np.ones(10)
    found = records(built(coefficients, ("2x2", "2x1", "1x1"), Eq31(), (0,)))
    # 4x4, 2x4, 4x2 and 2x2 are 2x2; 1x2 is 1x1.
    np.testing.assert_array_equal(
        found.coefficients[0, 0, 0, :, 0], [0, 0, 0, 0, 2, 1, 2]
    )


def test_records_of_separable_tensors():
    basis = TensorPolynomial((1, 0, 2), 0.01)
    coefficients = np.random.default_rng(0).normal(size=(1, 3, 1, 6))
    found = records(built(coefficients, SIDES, basis, (0,)))
    assert (found.basis, found.degrees, found.rates) == ("tensor", (1, 0, 2), SIDES)
    assert found.shortest_travel == 0.01 and found.floats == 8 and found.count == 3


def test_levels_between_whole_ones_have_no_record():
    tables = built(np.ones((2, 7, 1, 10)), RATES.names, Eq31(), (0, 0.5))
    with pytest.raises(ValueError, match="`mip_levels` must be whole numbers"):
        records(tables)


@pytest.mark.parametrize("degrees", [None, (5, 2, 4)])
def test_texels_hold_the_records(tmp_path, degrees):
    found = drawn(2, 50, 12, 3, degrees)
    made = texels(found)
    height, width, _ = made.pixels.shape
    assert width == 2048 and made.texels_a_record == (3 if degrees is None else 23)
    assert made.records_a_row == 2048 // made.texels_a_record
    assert (
        (height - 1) * made.records_a_row < found.count <= height * made.records_a_row
    )
    padded = found.padded()
    for index in (0, 1, made.records_a_row - 1, made.records_a_row, found.count - 1):
        row, place = divmod(index, made.records_a_row)
        first = place * made.texels_a_record
        record = made.pixels[row, first : first + made.texels_a_record]
        np.testing.assert_array_equal(record.ravel(), padded[index])
    write_rgba32f(tmp_path / "t.rgba32f", found)
    np.testing.assert_array_equal(read_rgba32f(tmp_path / "t.rgba32f"), padded)
    assert (tmp_path / "t.rgba32f").stat().st_size == width * height * 16
    about = json.loads((tmp_path / "t.rgba32f.json").read_text())
    assert (about["width"], about["height"]) == (width, height)
    assert (about["textures"], about["mips"], about["rates"]) == (50, 12, 3)


@pytest.mark.parametrize(
    "name, value, message",
    [
        ("schema", None, "`schema` must be 'alsarr-records-texture/1', got None"),
        ("width", 0, "`width` must be a whole number >= 1, got 0"),
        ("height", 2, "`records` must fill 2 rows of 2048 texels"),
        ("records", 683, "`records` must fill 1 rows of 2048 texels, got 683"),
        ("records_a_row", 700, "`records` must fill 1 rows of 2048 texels"),
        ("width", 4096, "must have 65536 bytes, got 32768"),
        ("records", 83, "must be 0 beside the records"),
    ],
)
def test_contradicting_texels_are_refused(tmp_path, name, value, message):
    path = tmp_path / "t.rgba32f"
    write_rgba32f(path, drawn())
    beside = tmp_path / "t.rgba32f.json"
    beside.write_text(json.dumps(json.loads(beside.read_text()) | {name: value}))
    with pytest.raises(ValueError, match=f"t.rgba32f.*: {message}"):
        read_rgba32f(path)


@pytest.mark.parametrize(
    "at, value, message",
    [
        (8, np.nan, "must hold finite numbers"),
        (2047 * 4, np.inf, "must hold finite numbers"),
        (2047 * 4, 1, "must be 0 beside the records"),
    ],
)
def test_altered_texels_are_refused(tmp_path, at, value, message):
    path = tmp_path / "t.rgba32f"
    write_rgba32f(path, drawn())
    numbers = np.frombuffer(path.read_bytes(), "<f4").copy()
    numbers[at] = value
    path.write_bytes(numbers.tobytes())
    with pytest.raises(ValueError, match=f"t.rgba32f: {message}"):
        read_rgba32f(path)
    path.write_bytes(numbers.tobytes()[:-4])
    with pytest.raises(ValueError, match="must have 32768 bytes, got 32764"):
        read_rgba32f(path)


def test_more_texels_than_fit_are_refused():
    long = drawn(1, 1, 1, 3, (127, 15, 4))
    with pytest.raises(ValueError, match="records of 2048 texels, got 2560"):
        texels(long)
    # Of records of 1088 texels one fits a row; what is broadcast takes no memory.
    zeros = np.broadcast_to(np.float32(0), (1, 2341, 1, 7, 4352))
    many = Records(zeros, "tensor", (255, 16, 0), DOMAIN, 0.01)
    with pytest.raises(ValueError, match="must fit 16384 rows .*, got 16387 rows"):
        texels(many)

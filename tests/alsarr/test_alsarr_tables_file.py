"""Tables as files: every bit comes back, and nothing damaged does."""

import hashlib
import io
import json
import pickle
import random
import zipfile

import equinox as eqx
import jax.numpy as jnp
import jsonschema
import numpy as np
import pytest

from alsarr import RATES
from alsarr.tables import (
    _file,
    Certificate,
    Conditions,
    Domain,
    Eq31,
    Eq31LogTravel,
    load_tables,
    QualityTables,
    save_tables,
    TensorPolynomial,
)


TENSOR = TensorPolynomial((2, 1, 2), 0.5 / 60)


def single(x):
    """Numbers that single precision holds, as a file does."""
    return np.asarray(x, np.float32)


def tables(
    basis=None,
    *,
    directions=2,
    rates=RATES.names,
    relative_to="4x4",
    tolerance=None,
    constant=False,
    value=0.0,
    seed=0,
):
    """Two textures with an entry each at some of three levels, and one without any.

    The last entry is the second texture's, at both of its levels.
    """
    basis = basis or Eq31()
    rng = np.random.default_rng(seed)
    shape = (3, len(rates), directions)
    coefficients = rng.normal(size=(*shape, basis.num_coefficients))
    coefficients = coefficients * 10.0 ** rng.integers(-6, 3, coefficients.shape)
    if constant:
        coefficients[2] = basis.constant(value)
    errors = np.abs(rng.normal(size=(3, *shape)))
    sample = [rng.uniform(*ends, 11) for ends in [(0, 50), (30, 120), (-1, 2.5)]]
    return QualityTables(
        coefficients=single(coefficients),
        entry=np.array([[0, 1, 1], [2, 2, 2], [-1, -1, -1]]),
        occurs=np.array([[1, 1, 0], [0, 1, 1], [0, 0, 0]]),
        constant=np.array([False, False, constant]),
        mip_levels=(0.0, 1.0, 3.0),
        domain=Domain(log10_luminance=(-1.0, np.log10(300.0))),
        certificate=Certificate(
            largest=single(errors[0]),
            percentile_99=single(errors[1]),
            median=single(errors[2]),
            overall=single([0.25, 0.1, 1 / 3]),
            sample=Conditions(*(jnp.asarray(single(x), float) for x in sample)),
        ),
        basis=basis,
        rates=rates,
        texture_names=("brick", "grass", "sky"),
        model="camojab 0.1.0, a display",
        relative_to=relative_to,
        tolerance_jnd=tolerance,
    )


VARIETY = {
    "eq31": {},
    "two-step": {"basis": Eq31("two-step")},
    "log-travel": {"basis": Eq31LogTravel(), "directions": 1},
    "tensor": {"basis": TENSOR, "tolerance": 0.3},
    "tensor-constant": {"basis": TENSOR, "constant": True, "tolerance": 0.1},
    "eq31-constant": {"constant": True, "tolerance": 0.5, "directions": 1},
    "own-quality": {"relative_to": None, "constant": True, "value": -0.3},
    "subset": {"rates": ("2x2", "2x1", "1x1"), "relative_to": "2x2"},
    "separable": {"rates": ("4", "2", "1"), "relative_to": "4"},
}
SCHEMA = jsonschema.Draft202012Validator(_file.schema())


def accepted(document):
    return SCHEMA.is_valid(document)


@pytest.mark.parametrize("ending", ["json", "npz"])
@pytest.mark.parametrize("kind", VARIETY)
def test_everything_comes_back(tmp_path, kind, ending):
    table = tables(**VARIETY[kind])
    path = tmp_path / f"tables.{ending}"
    save_tables(path, table)
    read = load_tables(path)
    bits = lambda t: single(t.coefficients).tobytes()
    assert bits(read) == bits(table)
    assert eqx.tree_equal(read, table)
    before = path.read_bytes()
    save_tables(path, read)
    assert eqx.tree_equal(load_tables(path), table)
    if ending == "json":
        assert path.read_bytes() == before


@pytest.mark.parametrize("kind", VARIETY)
def test_the_schema_accepts_what_is_written(tmp_path, kind):
    path = tmp_path / "tables.json"
    save_tables(path, tables(**VARIETY[kind]))
    SCHEMA.validate(json.loads(path.read_text()))


def test_the_schema_is_one_and_describes_every_field():
    schema = _file.schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    assert "://" not in schema["$id"]
    assert set(schema["properties"]) == set(schema["required"]) == _file._HEADER
    objects = [schema]
    seen = 0
    while objects:
        node = objects.pop()
        if isinstance(node, list):
            objects += node
        if isinstance(node, dict):
            objects += [v for k, v in node.items() if k != "oneOf"]
            if node.get("type") == "object" and "properties" in node:
                assert node["additionalProperties"] is False
                assert all("description" in p for p in node["properties"].values())
                seen += 1
    assert seen >= 10


def document(**changes):
    """What a file of some tables holds."""
    table = tables(constant=True, tolerance=0.5, **changes)
    header, arrays = _file._parts(table)
    whole = _file._sealed(_file._document(header, arrays))
    return json.loads(json.dumps(whole))


def at(place, change):
    """A document with one place of it changed."""
    whole = document()
    node = whole
    for step in place[:-1]:
        node = node[step]
    if change is DROP:
        del node[place[-1]]
    else:
        node[place[-1]] = change
    return whole


DROP = object()
# Place, what is put there, and what loading says if the checksum is right.
BROKEN = {
    "schema": (("schema",), "alsarr-tables/2", "`schema` must be .*, got '.*/2'"),
    "unit": (("unit",), "JOD", "`unit` must be 'JND', got 'JOD'"),
    "missing": (("model",), DROP, "lacks or should not have `model`"),
    "unknown": (("author",), "me", "lacks or should not have `author`"),
    "basis": (("basis", "name"), "spline", "`basis` must be one of eq31"),
    "setting": (("basis", "degrees"), [1, 1, 1], "must have the settings of eq31"),
    "no-basis": (("basis",), "eq31", "lacks or has another kind of"),
    "few": (
        ("basis",),
        TENSOR.describe(),
        r"`coefficients` must have shape \(7, 2, 18",
    ),
    "axis": (
        ("variables", "velocity"),
        DROP,
        "lacks or has another kind of 'velocity'",
    ),
    "order": (
        ("variables", "velocity", "domain"),
        [5, 1],
        "`velocity` must be lowest first, then highest",
    ),
    "short": (("variables", "velocity", "domain"), [5], r"must have shape \(2,\)"),
    "still": (
        ("variables", "refresh_rate", "domain"),
        [0, 60],
        "`refresh_rate` must be > 0 Hz",
    ),
    "rates": (("rates",), list(RATES.names[::-1]), "`rates` must be some of|shape"),
    "texture": (("entries", 0, "texture"), "stone", "'stone' is not in list"),
    "twice": (("entries", 2, "texture"), "brick", "one entry for a texture and one of"),
    "level": (("entries", 0, "mip_levels"), [7], "one of the mip levels, got 0 at 7"),
    "no-level": (("entries", 0, "mip_levels"), [], "must each have a mip level"),
    "falling": (("mip_levels",), [3, 1, 0], "`mip_levels` must be one or more, rising"),
    "text": (("entries", 0, "coefficients", 0, 0, 3), "1", ""),
    "ragged": (("entries", 0, "coefficients", 0, 0), [1.0], "must be numbers of shape"),
    "huge": (
        ("entries", 0, "coefficients", 0, 0, 0),
        10**400,
        "must be numbers of shape|must be finite",
    ),
    "beyond": (("entries", 0, "coefficients", 0, 0, 0), 1e39, "must be finite"),
    "no-numbers": (("entries", 0, "coefficients"), DROP, "another kind of 'coeff"),
    "no-value": (("entries", 2, "value_jnd"), DROP, "another kind of 'value_jnd'"),
    "null-value": (("entries", 2, "value_jnd"), None, "lacks or has another kind of"),
    "error": (("entries", 0, "largest_jnd"), "small", "`largest_jnd` must be numbers"),
    "overall": (("certificate", "median_jnd"), DROP, "another kind of 'median_jnd'"),
    "sample": (("certificate", "sample", "velocity"), DROP, "another kind of 'veloc"),
    "tolerance": (("tolerance_jnd",), [0.1], "lacks or has another kind of"),
    "reference": (("relative_to",), "8x8", "`relative_to` must be one of 4x4"),
}
# What no schema can tell: what must rise, refer to one another or multiply up.
ALL_THE_SAME = ("order", "rates", "few", "texture", "twice", "level", "falling")


@pytest.mark.parametrize("kind", BROKEN)
def test_the_schema_rejects_what_is_broken(kind):
    place, change, _ = BROKEN[kind]
    assert accepted(document())
    assert accepted(at(place, change)) == (kind in ALL_THE_SAME)


def resealed(whole):
    rest = {k: v for k, v in whole.items() if k != "sha256"}
    text = json.dumps(rest, sort_keys=True)
    return rest | {"sha256": hashlib.sha256(text.encode()).hexdigest()}


@pytest.mark.filterwarnings("ignore:overflow encountered in cast:RuntimeWarning")
@pytest.mark.parametrize("kind", [kind for kind in BROKEN if BROKEN[kind][2]])
def test_what_is_wrong_with_a_file_is_named(tmp_path, kind):
    """Even where whoever wrote it made the checksum of it right."""
    place, change, message = BROKEN[kind]
    path = tmp_path / "tables.json"
    path.write_text(json.dumps(resealed(at(place, change))))
    with pytest.raises(ValueError, match=f"tables.json: .*({message})"):
        load_tables(path)
    path.write_text(json.dumps(resealed(document())))
    load_tables(path)


def test_one_digit_altered_is_found_out(tmp_path):
    path = tmp_path / "tables.json"
    save_tables(path, tables())
    text = path.read_text()
    rng = random.Random(0)
    digits = [i for i, letter in enumerate(text) if letter.isdigit()]
    for place in rng.sample(digits, 100):
        other = rng.choice([d for d in "123456789" if d != text[place]])
        path.write_text(text[:place] + other + text[place + 1 :])
        # A digit before the point of 10 may make it no number of this field.
        with pytest.raises(ValueError, match="tables.json: "):
            load_tables(path)
    path.write_text(text.replace('"largest_jnd": 0.25', '"largest_jnd": 0.15'))
    with pytest.raises(ValueError, match="altered after it was written: its checksum"):
        load_tables(path)


@pytest.mark.parametrize("ending", ["json", "npz"])
def test_bits_flipped_and_ends_cut_off_are_found_out(tmp_path, ending):
    """Either a clear error or, where it does not matter, the same tables."""
    path = tmp_path / f"tables.{ending}"
    save_tables(path, tables())
    whole, good = path.read_bytes(), load_tables(path)
    rng = random.Random(0)
    for _ in range(150):
        damaged = bytearray(whole)
        damaged[rng.randrange(len(whole))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        try:
            assert eqx.tree_equal(load_tables(path), good)
        except ValueError as error:
            assert str(error).startswith(str(path))
    cuts = [0, 1, len(whole) // 2, len(whole) - 3]
    for end in cuts + rng.sample(range(len(whole) - 2), 20):
        path.write_bytes(whole[:end])
        with pytest.raises(ValueError, match=f"tables.{ending}: "):
            load_tables(path)


@pytest.mark.parametrize(
    "text",
    ["", "{", "\ufeff{}", "[1]", "{}", "null", "[" * 100_000, '{"unit": NaN}'],
    ids=range(8),
)
def test_foreign_json_is_refused(tmp_path, text):
    path = tmp_path / "tables.json"
    path.write_text(text, encoding="utf-8")
    rule = "is no JSON|must hold one JSON object|`schema` must be"
    with pytest.raises(ValueError, match=f"tables.json: ({rule})"):
        load_tables(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match="tables.json: is no JSON"):
        load_tables(path)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_what_is_no_number_is_refused(tmp_path, number):
    path = tmp_path / "tables.json"
    save_tables(path, tables())
    text = path.read_text()
    path.write_text(text.replace('"largest_jnd": 0.25', f'"largest_jnd": {number}'))
    with pytest.raises(
        ValueError, match="tables.json: .*(is no number|not JSON compl)"
    ):
        load_tables(path)


def npz(path, **changes):
    """The arrays of a good file, with some changed, and its header as it was."""
    good = path.with_name("good.npz")
    save_tables(good, tables())
    with np.load(good) as stored:
        arrays = {name: stored[name] for name in stored.files}
    np.savez(path, **{k: v for k, v in (arrays | changes).items() if v is not DROP})


def test_foreign_npz_is_refused(tmp_path):
    path = tmp_path / "tables.npz"
    np.savez(path, a=np.zeros(3))
    with pytest.raises(ValueError, match="tables.npz: lacks or has another kind of"):
        load_tables(path)
    for name in ("coefficients", "errors", "sample"):
        npz(path, **{name: DROP})
        with pytest.raises(ValueError, match=f"tables.npz: lacks .*{name}"):
            load_tables(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "nothing")
    with pytest.raises(ValueError, match="tables.npz: lacks or has another kind of"):
        load_tables(path)
    path.write_text("no archive")
    with pytest.raises(ValueError, match="tables.npz: is no NPZ file, or was cut off"):
        load_tables(path)


def test_arrays_altered_are_found_out(tmp_path):
    path = tmp_path / "tables.npz"
    npz(path)
    load_tables(path)
    wrong = np.array(tables().coefficients, np.float32)
    wrong[2, 3, 1, 4] = np.nextafter(wrong[2, 3, 1, 4], np.float32(9))
    npz(path, coefficients=wrong)
    with pytest.raises(ValueError, match="tables.npz: .* its checksum differs"):
        load_tables(path)
    npz(path, header=np.array("{}"))
    with pytest.raises(ValueError, match="tables.npz: `schema` must be"):
        load_tables(path)
    npz(path, header=np.array("no json"))
    with pytest.raises(ValueError, match=r"tables\.npz: "):
        load_tables(path)
    npz(path, coefficients=np.array(["x"]))
    with pytest.raises(ValueError, match=r"tables\.npz: "):
        load_tables(path)


class Trap:
    def __reduce__(self):
        return pytest.fail, ("a pickle was opened",)


def test_pickles_are_never_opened(tmp_path):
    path, pickled = tmp_path / "tables.npz", io.BytesIO()
    trap = np.empty(1, object)
    trap[0] = Trap()
    np.lib.format.write_array(pickled, trap, allow_pickle=True)
    npz(tmp_path / "other.npz")
    with (
        zipfile.ZipFile(tmp_path / "other.npz") as good,
        zipfile.ZipFile(path, "w") as archive,
    ):
        for name in good.namelist():
            own = name == "coefficients.npy"
            archive.writestr(name, pickled.getvalue() if own else good.read(name))
    with pytest.raises(ValueError, match="tables.npz: .*[Pp]ickle|Object arrays"):
        load_tables(path)
    path.write_bytes(pickle.dumps(Trap()))
    with pytest.raises(ValueError, match="tables.npz: is no NPZ"):
        load_tables(path)


@pytest.mark.parametrize("ending", ["json", "npz"])
def test_oversized_files_are_not_read(tmp_path, monkeypatch, ending):
    path = tmp_path / f"tables.{ending}"
    save_tables(path, tables())
    monkeypatch.setattr(_file, "_MOST_BYTES", path.stat().st_size)
    if ending == "json":
        load_tables(path)
    else:
        # Packed it is small enough, unpacked it is not.
        with pytest.raises(ValueError, match="tables.npz: must unpack to at most"):
            load_tables(path)
    monkeypatch.setattr(_file, "_MOST_BYTES", path.stat().st_size - 1)
    with pytest.raises(ValueError, match=f"tables.{ending}: must have at most"):
        load_tables(path)


def test_other_endings_are_refused(tmp_path):
    for name in ("tables.bin", "tables"):
        with pytest.raises(ValueError, match="`path` must end in .json or .npz, got"):
            save_tables(tmp_path / name, tables())
    assert not list(tmp_path.iterdir())
    (tmp_path / "tables.txt").write_text("{}")
    with pytest.raises(ValueError, match="tables.txt: `path` must end in"):
        load_tables(tmp_path / "tables.txt")
    with pytest.raises(FileNotFoundError):
        load_tables(tmp_path / "none.json")


@pytest.mark.parametrize("ending", ["json", "npz"])
def test_a_failure_leaves_the_old_file_alone(tmp_path, monkeypatch, ending):
    path = tmp_path / f"tables.{ending}"
    save_tables(path, tables())
    before = path.read_bytes()
    spoilt = eqx.tree_at(
        lambda t: t.coefficients, tables(), jnp.full((3, 7, 2, 10), jnp.nan)
    )
    with pytest.raises(ValueError, match="`tables` must hold numbers that are finite"):
        save_tables(path, spoilt)

    def full(*_, **__):
        raise OSError("no space left")

    monkeypatch.setattr(np, "savez_compressed", full)
    monkeypatch.setattr(_file, "write_text", full)
    with pytest.raises(OSError, match="no space left"):
        save_tables(path, tables(seed=1))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.float64  # no other number is too large for single precision
def test_numbers_too_large_for_single_precision_are_refused(tmp_path):
    table = tables()
    table = eqx.tree_at(
        lambda t: t.coefficients, table, table.coefficients.at[0, 1, 0, 2].set(1e39)
    )
    with (
        pytest.warns(RuntimeWarning, match="overflow"),
        pytest.raises(ValueError, match="finite in float32"),
    ):
        save_tables(tmp_path / "tables.json", table)
    assert not list(tmp_path.iterdir())


def test_numbers_are_rounded_to_single_precision_once(tmp_path):
    """Double precision is rounded when it is written, to the nearest."""
    table = tables()
    wide = eqx.tree_at(lambda t: t.coefficients, table, table.coefficients * (1 + 1e-9))
    for ending in ("json", "npz"):
        save_tables(tmp_path / f"tables.{ending}", wide)
        read = load_tables(tmp_path / f"tables.{ending}")
        np.testing.assert_array_equal(
            single(read.coefficients), single(wide.coefficients)
        )
        assert read.coefficients.dtype == jnp.result_type(float)


def test_file_explains_itself_and_is_strict_json(tmp_path):
    path = tmp_path / "tables.json"
    save_tables(path, tables(tolerance=0.2, constant=True))
    refuse = lambda token: pytest.fail(f"{token} is no JSON")
    text = path.read_text()
    document = json.loads(text, parse_constant=refuse)
    assert document["schema"] == "alsarr-tables/3" and document["unit"] == "JND"
    assert document["basis"] == {"name": "eq31", "method": "joint"}
    assert document["formula"] == Eq31().formula()
    assert document["rates"] == list(RATES.names)
    assert document["directions"] == ["x", "y"]
    assert document["textures"] == ["brick", "grass", "sky"]
    assert document["mip_levels"] == [0, 1, 3]
    assert document["variables"]["velocity"] == {
        "symbol": "v",
        "unit": "deg/s",
        "domain": [0, 50],
    }
    assert (document["tolerance_jnd"], document["meets_tolerance"]) == (0.2, False)
    certificate = document["certificate"]
    assert certificate["largest_jnd"] == 0.25
    assert certificate["median_jnd"] == 0.333333343
    assert {len(x) for x in certificate["sample"].values()} == {11}
    assert document["model"] == "camojab 0.1.0, a display"
    owners = [(e["texture"], e["mip_levels"]) for e in document["entries"]]
    assert owners == [("brick", [0]), ("brick", [1]), ("grass", [1, 3])]
    assert document["entries"][2]["value_jnd"] == 0
    assert list(document)[-1] == "sha256"
    assert document == resealed(document)
    digits = []

    def numbers(text):
        mantissa = text.strip("-").split("e")[0].replace(".", "").strip("0")
        digits.append(len(mantissa))
        return float(text)

    lines = [line for line in text.splitlines() if line.startswith('  {"texture"')]
    for line in lines:
        json.loads(line.rstrip(","), parse_float=numbers)
    assert len(lines) == 3 and max(digits) == 9
    # Most numbers of single precision take all nine, and no fewer would do.
    assert np.mean(np.array(digits) >= 8) > 0.5


def test_float32_and_float64_lanes_write_the_same(tmp_path):
    """The domain's own digits apart, which are those of the lane."""
    path = tmp_path / "tables.json"
    save_tables(path, tables())
    document = json.loads(path.read_text())
    found = np.float32(document["variables"]["log10_luminance"]["domain"][1])
    assert found == np.float32(np.log10(300))
    want = single(tables().coefficients)[1, 2, 1].astype(float)
    got = document["entries"][1]["coefficients"][2][1]
    assert [f"{x:.9g}" for x in want] == [f"{x:.9g}" for x in got]

"""`alsarr export`: what it writes, and what it refuses before it writes anything."""

import json
import re

import jax.numpy as jnp
import numpy as np
import pytest
import typer

from alsarr import RATES
from alsarr._export_command import export
from alsarr.export import (
    read_binary,
    read_rates_bin,
    read_rates_godot,
    read_rates_grey,
    read_rates_json,
    read_rgba32f,
    records,
    shader,
)
from alsarr.tables import (
    Certificate,
    Conditions,
    Domain,
    Eq31,
    load_tables,
    QualityTables,
    save_tables,
)
from camojab import _command as command


def run(*argv):
    app = typer.Typer(add_completion=False)
    app.command()(export)
    return command.run(app, "alsarr export", [str(word) for word in argv])


@pytest.fixture(scope="module")
def tables_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("tables") / "tables.json"
    errors = np.zeros((2, 7, 2))
    tables = QualityTables(
        coefficients=np.random.default_rng(0).normal(size=(2, 7, 2, 10)),
        entry=np.array([[0, 1]]),
        occurs=np.ones((1, 2), bool),
        constant=np.zeros(2, bool),
        mip_levels=(0, 1),
        domain=Domain(),
        certificate=Certificate(
            largest=errors,
            percentile_99=errors,
            median=errors,
            overall=np.zeros(3),
            sample=Conditions(*[jnp.ones(1)] * 3),
        ),
        basis=Eq31(),
        texture_names=("one",),
        model="a model",
        relative_to=None,
    )
    save_tables(path, tables)
    return path


def test_tables_become_all_that_is_asked_for(tables_file, tmp_path, capsys):
    out = tmp_path / "engine"
    assert run(tables_file, "--to", "hlsl,glsl,wgsl,binary,rgba32f", "-o", out) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed == [
        str(out / name)
        for name in (
            "quality.hlsl",
            "quality_450.comp",
            "quality_310es.comp",
            "quality.wgsl",
            "tables.bin",
            "tables.rgba32f",
            "tables.rgba32f.json",
        )
    ]
    assert sorted(printed) == sorted(map(str, out.iterdir()))
    tables = load_tables(tables_file)
    for name, language in {
        "quality.hlsl": "hlsl",
        "quality_450.comp": "glsl450",
        "quality_310es.comp": "glsl310es",
        "quality.wgsl": "wgsl",
    }.items():
        assert (out / name).read_text() == shader(tables, language)
    found = records(tables)
    in_file = read_binary(out / "tables.bin")
    np.testing.assert_array_equal(in_file.coefficients, found.coefficients)
    texels = read_rgba32f(out / "tables.rgba32f")
    np.testing.assert_array_equal(texels, found.padded())


@pytest.fixture
def rates_file(tmp_path):
    """Rates of a frame of 1920 x 1080 in whole tiles, as alsarr solve writes them."""
    path = tmp_path / "rates.npz"
    rate = np.random.default_rng(0).integers(0, 7, 67 * 120)
    np.savez(path, rate=rate, quality_jnd=1.0, cost=1.0)
    return path


def test_rates_become_all_that_is_asked_for(rates_file, tmp_path, capsys):
    out = tmp_path / "engine"
    to = "d3d12,vulkan,godot,unity,unreal"
    assert run(rates_file, "--to", to, "-o", out, "--columns", 120) == 0
    printed = capsys.readouterr().out.splitlines()
    assert sorted(printed) == sorted(map(str, out.iterdir())) and len(printed) == 9
    rate = np.load(rates_file)["rate"].reshape(67, 120)
    for api in ("d3d12", "vulkan"):
        np.testing.assert_array_equal(read_rates_bin(out / f"rates.{api}.bin"), rate)
        np.testing.assert_array_equal(read_rates_grey(out / f"rates.{api}.png"), rate)
    np.testing.assert_array_equal(read_rates_godot(out / "rates.godot.png"), rate)
    for engine in ("unity", "unreal"):
        path = out / f"rates.{engine}.json"
        np.testing.assert_array_equal(read_rates_json(path), rate)


def test_rates_are_those_of_the_hardware(rates_file, tmp_path):
    few = "1x1,1x2,2x1,2x2"
    options = ["--tile", 8, "--rates", few, "--size", "1920x1080", "-o", tmp_path]
    assert run(rates_file, "--to", "d3d12", *options) == 0
    rate = read_rates_bin(tmp_path / "rates.d3d12.bin")
    assert rate.shape == (135, 240)
    assert {RATES.names[i] for i in np.unique(rate)} == set(few.split(","))
    about = json.loads((tmp_path / "rates.d3d12.bin.json").read_text())
    assert about["tile_px"] == 8


@pytest.mark.parametrize(
    "size, tiles, shape",
    [
        ("1920x1080", 120 * 67, (68, 120)),
        ("1920x1080", 120 * 68, (68, 120)),
        ("1080x1920", 120 * 67, (120, 68)),
        ("1080x1920", 120 * 68, (120, 68)),
    ],
)
def test_size_tells_the_columns(tmp_path, size, tiles, shape):
    np.savez(tmp_path / "r.npz", rate=np.arange(tiles) % 7)
    options = ["--to", "godot", "--size", size, "-o", tmp_path]
    assert run(tmp_path / "r.npz", *options) == 0
    rate = read_rates_godot(tmp_path / "rates.godot.png")
    assert rate.shape == shape
    columns = shape[1] - (tiles == 120 * 67 and shape[1] == 68)
    np.testing.assert_array_equal(rate[1, :columns], (columns + np.arange(columns)) % 7)


def test_a_map_in_rows_needs_no_columns(tmp_path):
    np.savez(tmp_path / "r.npz", rate=np.array([[0, 6, 3]]))
    assert run(tmp_path / "r.npz", "--to", "godot", "-o", tmp_path) == 0
    rate = read_rates_godot(tmp_path / "rates.godot.png")
    np.testing.assert_array_equal(rate, [[0, 6, 3]])


@pytest.mark.parametrize(
    "options, message",
    [
        (["--to", "wgsl"], "`--to` must be some of d3d12, .* for rates, got 'wgsl'"),
        (["--to", "godot,"], "`--to` must be some of d3d12, .*, got ''"),
        (["--to", "godot"], "`--columns` must divide the 8040 tiles of .*, got None"),
        (["--to", "godot", "--columns", "7"], "`--columns` must divide .*, got 7"),
        (["--to", "godot", "--columns", "0"], "`--columns` must divide .*, got 0"),
        (["--to", "godot", "--size", "640x480"], "`--columns` must divide"),
        (["--to", "godot", "--columns=134", "--size=9x9"], "`--size` must be that of"),
        (
            ["--to", "godot", "--columns=134", "--tile=4"],
            "`--tile` must be 8, 16 or 32",
        ),
        (["--to", "godot", "--columns=134", "--rates=2x2"], "`--rates` must be 1x1"),
    ],
)
def test_wrong_options_write_nothing(rates_file, tmp_path, capsys, options, message):
    out = tmp_path / "engine"
    assert run(rates_file, *options, "-o", out) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert re.search(message, error), error
    assert not out.exists()


def test_a_size_that_is_none(rates_file, tmp_path, capsys):
    out = tmp_path / "engine"
    assert run(rates_file, "--to", "godot", "--size", "1920", "-o", out) == 2
    assert "'--size': must be a width and a height" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    "options, message",
    [
        (["--to", "hlsl,metal"], "some of hlsl, .* for tables, got 'metal'"),
        (["--to", "godot"], "some of hlsl, .* for tables, got 'godot'"),
        (["--to", "hlsl", "--tile", "8"], "`--tile` must go with a file of rates"),
    ],
)
def test_wrong_options_for_tables(tables_file, tmp_path, capsys, options, message):
    assert run(tables_file, *options, "-o", tmp_path / "engine") == 1
    assert re.search(message, capsys.readouterr().err)
    assert not (tmp_path / "engine").exists()


@pytest.mark.parametrize(
    "rate, options, message",
    [
        (np.zeros(4), ["--columns", "2"], "`rate` must be whole numbers"),
        (np.full((2, 2), 7), [], "`rate` must be indices from 0 to 6"),
        (np.zeros((2, 2), int), ["--columns", "4"], "`--columns` must be that of the"),
        (np.zeros((2, 2, 2), int), [], "`rate` must be whole numbers of shape"),
        (np.array([None]), [], "must hold whole, plain arrays"),
    ],
)
def test_rates_that_are_none(tmp_path, capsys, rate, options, message):
    path = tmp_path / "r.npz"
    np.savez(path, rate=rate)
    assert run(path, "--to", "godot", "-o", tmp_path / "engine", *options) == 1
    error = capsys.readouterr().err
    assert message in error and str(path) in error and error.count("\n") == 1
    assert not (tmp_path / "engine").exists()


def test_damaged_and_foreign_files(rates_file, tables_file, tmp_path, capsys):
    for content in (
        rates_file.read_bytes()[:-60],
        tables_file.read_bytes()[:-60],
        b"x",
    ):
        path = tmp_path / "file"
        path.write_bytes(content)
        assert run(path, "--to", "godot,hlsl", "-o", tmp_path / "engine") == 1
        assert run(path, "--to", "hlsl", "-o", tmp_path / "engine") == 1
        assert f"{path}: " in capsys.readouterr().err
    assert run(tmp_path / "none", "--to", "hlsl") == 1
    assert str(tmp_path / "none") in capsys.readouterr().err
    assert not (tmp_path / "engine").exists()


def test_output_must_be_a_folder(rates_file, tmp_path, capsys):
    (tmp_path / "engine").write_text("mine")
    options = ["--columns", "120", "-o", tmp_path / "engine"]
    assert run(rates_file, "--to", "godot", *options) == 1
    assert "must be a folder to write into" in capsys.readouterr().err
    assert (tmp_path / "engine").read_text() == "mine"

"""`alsarr compare`: tables as text, CSV and figure."""

import csv
import re

import equinox as eqx
import imageio.v3
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import (
    _comparison,
    _inputs,
    Frame,
    load_frame,
    oracle,
    procedural_frame,
    RATES,
    save_frame,
    tables,
)
from alsarr._compare_command import _builtin, _jindal2021, _notes
from alsarr._comparison import compare, Setting
from alsarr.cli import main
from alsarr.oracle import TableOracle
from alsarr.tables import (
    Certificate,
    Conditions,
    Domain,
    Eq31,
    load_tables,
    QualityTables,
    save_tables,
)
from camojab import datasets, Spectrum


COLUMNS = [
    *("method", "budget_share", "refresh_rate_hz", "quality_jnd", "loss_jnd"),
    *("cost_share", "gap_jnd", *(f"share_{name}" for name in RATES.names)),
]


def run(*arguments):
    return main(["compare", *map(str, arguments)])


pytestmark = pytest.mark.usefixtures("quick_compilation")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two small frames, and tables whose qualities rise with rate and velocity."""
    path = tmp_path_factory.mktemp("compare")
    coefficients = np.zeros((3, 7, 2, 10))
    # The same at every condition, but other for each texture.
    for texture, most in enumerate((1.0, 0.3, 2.5)):
        for rate in range(7):
            value = most * rate / 6
            coefficients[texture, rate] = Eq31().constant(value)
    errors = np.zeros((3, 7, 2))
    made = QualityTables(
        coefficients=coefficients,
        entry=np.arange(3)[:, None],
        occurs=np.ones((3, 1), bool),
        constant=np.zeros(3, bool),
        mip_levels=(0,),
        domain=Domain(),
        certificate=Certificate(
            largest=errors,
            percentile_99=errors,
            median=errors,
            overall=np.zeros(3),
            sample=Conditions(*[jnp.ones(1)] * 3),
        ),
        basis=Eq31(),
        texture_names=("a", "b", "c"),
        model="a model",
        relative_to=None,
    )
    save_tables(path / "tables.json", made)
    for seed in (1, 2):
        drawn = procedural_frame(3, rows=5, columns=6, seed=seed)
        save_frame(path / f"{seed}.npz", drawn)
    return path


@pytest.fixture
def few(monkeypatch):
    """Some methods, because each is compiled, and the library's tests have them all."""
    every = _comparison.methods

    def keep(*names):
        of = lambda *given: [m for m in every(*given) if m.name in names]
        monkeypatch.setattr(_comparison, "methods", of)

    return keep


def own(folder, *seeds):
    frames = [part for seed in seeds for part in ("--frame", folder / f"{seed}.npz")]
    return [*frames, "--tables", folder / "tables.json"]


def read(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def same(written, judged):
    """Whether the rows of a file have the numbers of the library."""
    assert len(written) == len(judged)
    for row, wanted in zip(written, judged, strict=True):
        assert row["method"] == wanted.method
        numbers = [
            *(wanted.budget, wanted.refresh_rate, wanted.quality, wanted.loss),
            *(wanted.cost, wanted.gap, *wanted.shares),
        ]
        found = [float(row[name] or "nan") for name in COLUMNS[1:]]
        np.testing.assert_allclose(found, numbers, rtol=1e-6, atol=1e-7)


def test_table_file_and_figure_are_of_all_frames(folder, tmp_path, capsys, few):
    few("ALSaRR", "uniform")
    out = tmp_path / "new"
    assert run(*own(folder, 1, 2), "--budgets", "0.125,0.5", "-o", out) == 0
    printed = capsys.readouterr().out
    written = read(out / "comparison.csv")
    assert list(written[0]) == COLUMNS and len(written) == 4
    judge = TableOracle(load_tables(folder / "tables.json"))
    frames = [load_frame(folder / f"{seed}.npz") for seed in (1, 2)]
    rows = compare(Setting(frames, judge, 60.0, 60.0), (0.125, 0.5))
    same(written, rows)

    assert "Budget 12.5 % of full rate at 60 Hz" in printed
    assert "Budget 50 % of full rate at 60 Hz" in printed
    # What is the same in every row is not printed.
    assert "refresh rate [Hz]" not in printed and "quality [JND]" not in printed
    for row in rows:
        shares = [f"{share:.1%}" for share in row.shares]
        cells = [f"{row.loss:.3f}", f"{row.cost:.2%}", f"{row.gap:.1e}", *shares]
        line = " +".join(map(re.escape, [row.method, *cells]))
        assert re.search(f"^{line}$", printed, re.MULTILINE), (line, printed)
    assert printed.count("NAS and FidelityFX are left out: ") == 1
    assert "and not every file has previous_image.\n" in printed
    assert f"2 frames with {folder / 'tables.json'}, 60 px/deg" in printed
    assert "to quote: alsarr " in printed and "60 Hz\n" in printed
    figure = imageio.v3.imread(out / "comparison.png")
    assert figure.shape[0] > 500 and len(np.unique(figure)) > 50
    names = ["comparison.csv", "comparison.png"]
    assert sorted(path.name for path in out.iterdir()) == names


def test_refresh_rates_to_choose_from(folder, tmp_path, capsys, few):
    few("uniform", "MARRR")
    imageio.v3.imwrite(
        tmp_path / "view.png",
        np.random.default_rng(0).integers(60, 200, (512, 512), np.uint8),
    )
    display = ["--refresh-rate", 48, "--ppd", "50", "--persistence", "0.5"]
    options = ["--refresh-rates", "30-90:30", "--image", tmp_path / "view.png"]
    given = [*own(folder, 1), *display, *options, "--budgets", "0.25"]
    assert run(*given, "-o", tmp_path / "out") == 0
    printed = capsys.readouterr().out
    view = imageio.v3.imread(tmp_path / "view.png")
    setting = Setting(
        [load_frame(folder / "1.npz")],
        TableOracle(load_tables(folder / "tables.json")),
        50.0,
        48.0,
        (30.0, 60.0, 90.0),
        0.5,
        picture=Spectrum.from_texture(view),
    )
    rows = compare(setting, (0.25,))
    same(read(tmp_path / "out" / "comparison.csv"), rows)
    uniform, marrr = rows
    assert uniform.refresh_rate == 48 and marrr.refresh_rate in (30, 60, 90)
    assert read(tmp_path / "out" / "comparison.csv")[1]["gap_jnd"] == ""
    assert "Budget 25 % of full rate at 90 Hz" in printed
    assert "refresh rate [Hz]  quality [JND]  loss [JND]" in printed
    assert "persistence 0.5, 48 Hz or chosen from 30-90:30 Hz\n" in printed


@pytest.mark.parametrize(
    "options, message",
    [
        (["--budgets", "0.05"], r"`--budgets` must be in \[0.0625, 1\], .*, got 0.05"),
        (["--budgets", "0.5,2"], r"`--budgets` must be in \[0.0625, 1\], .*, got 2"),
        (["--budgets", "half"], "`--budgets` must be LOW-HIGH, .*, got 'half'"),
        (["--refresh-rates", "90-30"], "`--refresh-rates` must go from a lower to"),
        (["--refresh-rates", "0,90"], "`--refresh-rates` must be > 0 Hz and finite"),
        (
            ["--refresh-rates", "30,48"],
            "`--refresh-rate` must be at most the highest of `--refresh-rates`, 48 Hz, "
            "got 60",
        ),
        (
            ["--refresh-rates", "30,60"],
            "`--image` must be given where there are refresh rates to choose from, got",
        ),
        (["--image", "none.png"], "`--image` must be a file, jindal2021:NAME or"),
        (["--ppd", "0"], "`--ppd` must be finite and > 0"),
        (["--persistence", "2"], r"`--persistence` must be in \(0, 1\]"),
        (["--luminance", "0"], "`--luminance` must be finite and > 0"),
        (["--data", "builtin"], "`--data` must be left out with --frame, got builtin"),
    ],
)
def test_wrong_options_write_nothing(folder, tmp_path, capsys, options, message):
    assert run(*own(folder, 1), *options, "-o", tmp_path / "out") == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and re.search(message, error), error
    assert not (tmp_path / "out").exists()


def test_frames_need_tables(folder, tmp_path, capsys):
    out = tmp_path / "out"
    known, given = folder / "tables.json", folder / "1.npz"
    assert run("--frame", given, "-o", out) == 1
    assert "`--tables` must be given together, got `--frame` alo" in _error(capsys)
    assert run("--tables", known, "-o", out) == 1
    assert "`--tables` must be given together, got `--tables` al" in _error(capsys)
    assert run("--frame", folder / "none.npz", "--tables", known, "-o", out) == 1
    assert "none.npz: No such file" in _error(capsys)
    assert run("--frame", given, "--tables", given, "-o", out) == 1
    assert "1.npz: " in _error(capsys)
    assert run("--data", "other", "-o", out) == 2
    assert not out.exists()


def test_what_is_missing_or_not_known_is_said(folder, monkeypatch):
    judge = TableOracle(load_tables(folder / "tables.json"))
    plain = dict.fromkeys(["velocity_x", "velocity_y", "luminance"], 1.0)
    plain["mip_level"] = 0.0
    blind = Frame(texture=np.array([[0, 3]]), **plain)
    image = np.zeros((16, 48, 3), np.uint8)
    seen = Frame(texture=np.zeros((1, 3), int), **plain, previous_image=image)
    of = lambda *frames: _notes(Setting(frames, judge, 60.0, 60.0), "it is secret")
    left_out, unknown = of(blind)
    assert left_out.startswith("NAS and FidelityFX are left out: ")
    assert left_out.endswith(", and it is secret.")
    assert unknown.startswith("1 of 2 tiles show textures or conditions that the")
    assert of(seen) == []
    monkeypatch.setattr(_comparison, "_MOST_TILES", 2)
    (exact,) = of(seen)
    assert exact.startswith("The exact choice is left out: ")
    assert len(of(seen, blind)) == 3


def _error(capsys):
    error = capsys.readouterr().err
    assert error.count("\n") == 1, error
    return error


def test_output_must_be_a_folder(folder, tmp_path, capsys):
    (tmp_path / "out").write_text("mine")
    assert run(*own(folder, 1), "-o", tmp_path / "out") == 1
    assert "must be a folder to write into" in capsys.readouterr().err
    assert (tmp_path / "out").read_text() == "mine"


def test_the_published_frame_has_no_picture(real_data):
    real_data("jindal2021/ALSaRR/sample_data/scene_snapshot.png")
    real_data("jindal2021/ALSaRR/sample_data/all_polynomials.zip")
    name, why, given = _jindal2021(60.0, 40.0, True)
    setting = Setting(**given, ppd=60.0, refresh_rate=60.0, refresh_rates=(30, 120))
    assert setting.frames[0].shape == (67, 120) and setting.luminance == 40
    assert not setting.has_images and "SciFi" in name and "never published" in why
    # Its motion was rendered at 60 Hz, wherever it is shown.
    faster = dict(given, ppd=60.0, refresh_rate=30.0, refresh_rates=(30, 120))
    assert Setting(**faster).velocities == setting.velocities


def test_the_built_in_frame_has_its_picture_tables_and_model(folder, monkeypatch):
    small = lambda textures, **_: procedural_frame(textures, rows=2, columns=3, seed=0)
    monkeypatch.setattr(_inputs, "procedural_frame", small)
    seen, made = [], load_tables(folder / "tables.json")
    # Sampling, fitting and pooling take half a minute and have tests of their own.
    record = lambda *given, **more: seen.append((given, more))
    monkeypatch.setattr(tables, "sample", record)
    monkeypatch.setattr(tables, "distil", lambda samples, form: made)
    monkeypatch.setattr(oracle, "CamojabOracle", record)
    progress = lambda done, total: None
    _, _, given = _builtin(50.0, 0.5, 150.0, True, progress)
    frame = given["frames"][0]
    assert frame.previous_image.shape == (32, 48, 3)
    assert eqx.tree_equal(given["judge"], TableOracle(made))
    assert isinstance(given["picture"], Spectrum)
    (sampled, options), (modelled, more) = seen
    assert list(sampled[0]) == list(datasets.builtin_textures()) == list(modelled[0])
    texture, level = np.asarray(frame.texture), np.asarray(frame.mip_level)
    pairs = set(zip(texture.ravel().tolist(), level.ravel().tolist(), strict=True))
    assert set(sampled[1].pairs) == set(more["pairs"]) == pairs
    np.testing.assert_array_equal(sampled[1].domain.refresh_rate, (30, 150))
    assert options == {"progress": progress, "ppd": 50.0, "persistence": 0.5}
    assert (more["ppd"], more["persistence"]) == (50.0, 0.5)

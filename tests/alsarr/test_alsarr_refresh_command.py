"""`alsarr refresh`: the table as text, CSV and figure."""

import csv
import re

import imageio.v3
import numpy as np
import pytest

from alsarr._refresh import refresh_table
from alsarr.cli import main
from camojab import Spectrum


FULL = 320 * 180 * 90.0
OPTIONS = ["--rates", "30-90:30", "--velocities", "0,5,40", "--size", "320x180"]


def run(*arguments):
    return main(["refresh", *map(str, arguments)])


def grey():
    return np.random.default_rng(0).integers(60, 200, (64, 64), np.uint8)


@pytest.fixture
def image(tmp_path):
    imageio.v3.imwrite(tmp_path / "frame.png", grey().repeat(8, 0).repeat(8, 1))
    return tmp_path / "frame.png"


def rows(path):
    with path.open(newline="") as file:
        return [
            {name: float(value) for name, value in row.items()}
            for row in csv.DictReader(file)
        ]


def test_table_file_and_figure_have_the_same_numbers(image, tmp_path, capsys):
    out = tmp_path / "new"
    options = [*OPTIONS, "--ppd", "45", "--luminance", "80", "--persistence", "0.5"]
    options += ["--cells", "0", "--budget", "0.125", "--budget", "0.5", "-o", out]
    assert run(image, *options) == 0
    printed = capsys.readouterr().out
    spectrum = Spectrum.from_texture(grey().repeat(8, 0).repeat(8, 1))
    written = rows(out / "refresh.csv")
    assert len(written) == 6
    for budget, part in ((0.125, written[:3]), (0.5, written[3:])):
        table = refresh_table(
            spectrum,
            ppd=45.0,
            luminance=80.0,
            persistence=0.5,
            pixels_per_second=budget * FULL,
            resolution_px=(320, 180),
            refresh_rates=(30, 60, 90),
            velocities=(0, 5, 40),
        )
        for i, row in enumerate(part):
            assert row["pixels_per_second"] == budget * FULL
            assert row["velocity_deg_s"] == (0, 5, 40)[i]
            assert row["refresh_rate_hz"] == table.refresh_rate[i]
            np.testing.assert_allclose(
                row["resolution"], table.resolution[i], rtol=1e-6
            )
            np.testing.assert_allclose(row["quality_jnd"], table.quality[i], rtol=1e-5)
            line = rf"{row['velocity_deg_s']:g} +{row['refresh_rate_hz']:g} +"
            line += rf"{row['resolution']:.3f} +{row['quality_jnd']:.3f}\n"
            assert re.search(line, printed), (line, printed)
        assert f"Budget {100 * budget:g} % ({budget * FULL / 1e6:.4g} Mpx/s)" in printed
    assert "refresh rate [Hz]" in printed and "quality [JND]" in printed
    assert "to quote: alsarr " in printed and "ws=-3.6985" in printed
    figure = imageio.v3.imread(out / "refresh.png")
    assert figure.shape[0] > 500 and len(np.unique(figure)) > 50
    assert sorted(path.name for path in out.iterdir()) == ["refresh.csv", "refresh.png"]


def test_budgets_as_numbers_and_builtin_pictures(tmp_path, capsys):
    options = ["--pixels-per-second", FULL / 4, "--rates", "90,30,60", *OPTIONS[2:]]
    # As above, so that nothing is compiled again.
    options += ["--cells", "0", "-o", tmp_path]
    assert run("builtin:grass", *options) == 0
    written = rows(tmp_path / "refresh.csv")
    assert [row["pixels_per_second"] for row in written] == [FULL / 4] * 3
    assert {row["refresh_rate_hz"] for row in written} <= {30, 60, 90}
    assert "Budget 1.296 Mpx/s" in capsys.readouterr().out


@pytest.mark.parametrize(
    "options, message",
    [
        (["--rates", "30-"], "`--rates` must be LOW-HIGH, LOW-HIGH:STEP or .* '30-'"),
        (["--rates", "90-30"], "`--rates` must go from a lower to a higher .* '90-30'"),
        (["--rates", "30-90:0"], "`--rates` must go from a lower .* steps above 0"),
        (["--rates", "30,x"], "`--rates` must be LOW-HIGH"),
        (["--rates", "0,30"], "`--rates` must be > 0 Hz and finite, got 0"),
        (["--velocities", ""], "`--velocities` must be LOW-HIGH"),
        (["--budget", "0"], r"`--budget` must be in \(0, 1\], got 0"),
        (["--budget", "1.5"], r"`--budget` must be in \(0, 1\], got 1\.5"),
        (["--budget", "0.01"], "the budget in px/s must be at least 108000, those of"),
        (["--pixels-per-second", "-1"], "the budget in px/s must be > 0 px/s"),
        (
            ["--budget", "0.5", "--pixels-per-second", "1e6"],
            "`--budget` must be left out where --pixels-per-second is given",
        ),
        (["--ppd", "0"], "`--ppd` must be finite and > 0"),
        (["--persistence", "0"], r"`--persistence` must be in \(0, 1\]"),
        (["--luminance", "0"], "`--luminance` must be finite and > 0"),
        (["--cells", "-3"], "`--cells` must be .*, got -3"),
    ],
)
def test_wrong_options_write_nothing(image, tmp_path, capsys, options, message):
    assert run(image, *OPTIONS, *options, "-o", tmp_path / "out") == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and re.search(message, error), error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("size", ["1920", "0x9", "9x"])
def test_a_size_that_is_none(image, tmp_path, capsys, size):
    out = tmp_path / "out"
    assert run(image, *OPTIONS, "--size", size, "-o", out) == 2
    error = capsys.readouterr().err
    assert (
        error.count("\n") == 1
        and f"height >= 1 px such as 640x368, got {size}" in error
    )
    assert not out.exists()


def test_pictures_that_cannot_be_used(image, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(tmp_path / "none.png", *OPTIONS, "-o", out) == 1
    assert (
        "IMAGE must be a file, jindal2021:NAME or builtin:" in capsys.readouterr().err
    )
    assert run("builtin:nothing", *OPTIONS, "-o", out) == 1
    assert "IMAGE must be one of builtin:" in capsys.readouterr().err
    imageio.v3.imwrite(image, np.zeros((9, 9, 3), np.uint8))
    assert run(image, *OPTIONS, "-o", out) == 1
    assert "`--encoding` must be named for a colour" in capsys.readouterr().err
    assert run(image, *OPTIONS, "--encoding", "none", "-o", out) == 2
    assert "--encoding" in capsys.readouterr().err
    image.write_text("no picture")
    assert run(image, *OPTIONS, "-o", out) == 1
    assert "IMAGE must be an image or an array" in capsys.readouterr().err
    assert not out.exists()


def test_output_must_be_a_folder(image, tmp_path, capsys):
    (tmp_path / "out").write_text("mine")
    assert run(image, *OPTIONS, "-o", tmp_path / "out") == 1
    assert "must be a folder to write into" in capsys.readouterr().err
    assert (tmp_path / "out").read_text() == "mine"

import csv
import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import get_args

import jax
import numpy as np
import pytest

from camojab import cli, Formulation, Spectrum
from camojab.cli import main


GOLDEN = Path(__file__).parent / "golden"

ROW = {
    "texture": "grey.npy",
    "mean_luminance_cd_m2": "100",
    "refresh_rate_hz": "60",
    "velocity_deg_s": "10",
    "persistence": "1",
    "ppd": "60",
    "rate_x": "0.5",
    "rate_y": "1",
    "mip_level": "1",
}
ADDED = ["spatial_distortion", "temporal_distortion", "quality_jnd"]
GRATING = {
    "spatial_frequency_cpd": "4",
    "temporal_frequency_hz": "10",
    "luminance_cd_m2": "100",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory with a grey texture and a table of one condition."""
    monkeypatch.chdir(tmp_path)
    np.save("grey.npy", np.random.default_rng(3).random((64, 64)))
    write("in.csv", [ROW])
    return tmp_path


def write(path, rows):
    with Path(path).open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def read(path):
    with Path(path).open(newline="") as file:
        return list(csv.DictReader(file))


def numbers(rows, column):
    return np.array([float(row[column]) for row in rows])


def lines(capsys):
    """What went to the error stream; nothing may have gone to the other."""
    captured = capsys.readouterr()
    assert captured.out == ""
    return captured.err.splitlines()


# Golden values: computed with the authors' program (tests/golden).


@pytest.mark.parametrize("precision, rtol", [("64", 1e-8), ("32", 1e-4)])
def test_golden_distortions(tmp_path, real_data, precision, rtol):
    real_data("jindal2021/Experiment_Data/vrs_exp_stimulus.mat")
    golden = read(GOLDEN / "model_dst.csv")
    rows = [row | {"texture": f"jindal2021:{row['texture']}"} for row in golden]
    write(tmp_path / "in.csv", rows)
    out = tmp_path / "out.csv"
    command = ["predict", str(tmp_path / "in.csv"), "-o", str(out)]
    assert main([*command, "--precision", precision]) == 0
    got = read(out)
    assert list(got[0]) == [*golden[0], *ADDED]
    for expected, name in (("E_s", ADDED[0]), ("E_t", ADDED[1])):
        np.testing.assert_allclose(
            numbers(got, name), numbers(golden, expected), rtol=rtol, err_msg=name
        )
    # Table 4 of Jindal et al. 2021, with the digits of the released program.
    ws, wt = -3.6985309427209785, -2.906819337217838
    quality = ws * numbers(got, ADDED[0]) + wt * numbers(got, ADDED[1])
    # The two parts may cancel; in single precision the constants are rounded too.
    atol = (1e-12 if precision == "64" else 1e-5) * np.max(np.abs(quality))
    np.testing.assert_allclose(numbers(got, ADDED[2]), quality, rtol=0, atol=atol)


def test_tolerance(tmp_path, capsys):
    row = read(GOLDEN / "model_dst.csv")[0] | {"texture": "builtin:grass"}
    speeds = np.linspace(5, 60, 50)
    write(tmp_path / "in.csv", [row | {"velocity_deg_s": str(v)} for v in speeds])
    command = ["predict", str(tmp_path / "in.csv"), "-o", str(tmp_path / "out.csv")]
    assert main(command) == 0
    exact = numbers(read(tmp_path / "out.csv"), ADDED[2])
    capsys.readouterr()
    assert main([*command, "--tolerance", "0.05"]) == 0
    assert "within 0.05 JND" in capsys.readouterr().out
    error = np.abs(numbers(read(tmp_path / "out.csv"), ADDED[2]) - exact)
    assert 0 < error.max() < 0.05
    assert main([*command, "--tolerance", "inf"]) == 1
    assert "`--tolerance` must be finite and >= 0 JND" in capsys.readouterr().err


@pytest.mark.parametrize("precision, rtol", [("64", 1e-10), ("32", 1e-4)])
def test_golden_sensitivities(tmp_path, precision, rtol):
    golden = read(GOLDEN / "csf.csv")
    inputs = [
        {("golden" if k == "sensitivity" else k): v for k, v in row.items()}
        for row in golden
    ]
    write(tmp_path / "in.csv", inputs)
    out = tmp_path / "out.csv"
    command = ["sensitivity", str(tmp_path / "in.csv"), "-o", str(out)]
    assert main([*command, "--precision", precision]) == 0
    got = read(out)
    assert list(got[0]) == [*GRATING, "golden", "sensitivity"]
    np.testing.assert_allclose(
        numbers(got, "sensitivity"), numbers(golden, "sensitivity"), rtol=rtol
    )


# What is written


def test_precision_is_that_of_the_option_and_not_left_behind(folder, capsys):
    before = jax.config.jax_enable_x64
    for bits in ("32", "64"):
        assert main(["predict", "in.csv", "-o", bits, "--precision", bits]) == 0
        assert capsys.readouterr().out.endswith(f"float{bits}\n")
    assert main(["predict", "in.csv", "-o", "default"]) == 0
    assert jax.config.jax_enable_x64 == before
    single, double = (float(read(bits)[0]["quality_jnd"]) for bits in ("32", "64"))
    assert single == np.float32(single) != double
    np.testing.assert_allclose(single, double, rtol=1e-4)
    assert Path("default").read_bytes() == Path("64").read_bytes()


def test_other_cells_are_kept_and_numbers_come_back_exactly(folder, capsys):
    notes = ["plain", "a, b", 'say "x"', "two\nlines", "", "Zoë"]
    rows = [{"id": f"00{i}", **ROW, "note": note} for i, note in enumerate(notes)]
    rows[1]["ppd"] = " 6.00e1"
    write("in.csv", rows)
    assert main(["predict", "in.csv", "-o", "sub/out.csv"]) == 0
    got = read("sub/out.csv")
    assert list(got[0]) == [*rows[0], *ADDED]
    assert [{k: v for k, v in row.items() if k not in ADDED} for row in got] == rows
    for name in ADDED:
        assert len({row[name] for row in got}) == 1
        assert got[0][name] == repr(float(got[0][name]))
    out = capsys.readouterr().out.splitlines()
    assert out[0] == f"{Path('sub/out.csv')}: 6 rows; kept as they are: id, note"
    assert out[1].startswith(f"camojab {version('alsarr')}, released, ws=-3.6985309, ")


def test_blank_lines_byte_order_mark_and_line_ends(folder):
    assert main(["predict", "in.csv", "-o", "out.csv"]) == 0
    header, row = Path("in.csv").read_text().split()
    Path("other.csv").write_bytes(f"\ufeff{header}\r\n\r\n{row}\r\n\r\n".encode())
    assert main(["predict", "other.csv", "-o", "other-out.csv"]) == 0
    assert Path("out.csv").read_bytes() == Path("other-out.csv").read_bytes()


def test_a_table_without_rows(folder):
    Path("in.csv").write_text(",".join(ROW) + "\n")
    assert main(["predict", "in.csv", "-o", "out.csv"]) == 0
    assert Path("out.csv").read_text() == ",".join([*ROW, *ADDED]) + "\n"


def test_a_file_may_be_written_over_itself(folder):
    assert main(["predict", "in.csv", "-o", "in.csv"]) == 0
    assert list(read("in.csv")[0]) == [*ROW, *ADDED]


def test_paths_are_sought_here_and_then_beside_the_table(folder, monkeypatch):
    other = folder / "elsewhere"
    other.mkdir()
    assert main(["predict", "in.csv", "-o", "out.csv"]) == 0
    monkeypatch.chdir(other)
    assert main(["predict", "../in.csv", "-o", "out.csv"]) == 0
    assert Path("out.csv").read_bytes() == Path("../out.csv").read_bytes()
    # A file of that name in the working directory comes first.
    np.save("grey.npy", np.full((8, 8), 0.5))
    assert main(["predict", "../in.csv", "-o", "out.csv"]) == 0
    assert Path("out.csv").read_bytes() != Path("../out.csv").read_bytes()


def test_colour_needs_its_encoding(folder, capsys):
    colour = np.random.default_rng(5).random((16, 16, 3))
    np.save("colour.npy", colour)
    write("in.csv", [ROW, ROW | {"texture": "colour.npy"}])
    assert main(["predict", "in.csv", "-o", "out.csv"]) == 1
    assert lines(capsys) == [
        "camojab: in.csv, line 3: in 'colour.npy', `--encoding` must be named for a "
        "colour texture ('sRGB', 'linear', ...), got None."
    ]
    assert main(["predict", "in.csv", "-o", "out.csv", "--encoding", "linear"]) == 0
    np.save("grey.npy", colour @ [0.2126, 0.7152, 0.0722])
    write("grey.csv", [ROW])
    assert main(["predict", "grey.csv", "-o", "grey-out.csv"]) == 0
    # The weights above are rounded to four digits.
    np.testing.assert_allclose(
        numbers(read("out.csv")[1:], "quality_jnd"),
        numbers(read("grey-out.csv"), "quality_jnd"),
        rtol=1e-3,
    )


# Parameters and formulation


def quality_with(*options):
    assert main(["predict", "in.csv", "-o", "out.csv", *options]) == 0
    return numbers(read("out.csv"), "quality_jnd")[0]


def save(formulation, **changes):
    values = {"ws": -3.6, "wt": -2.9, "beta": 0.36} | changes
    document = {"formulation": formulation.value, "parameters": values}
    Path("p.json").write_text(json.dumps(document))
    return ["--parameters", "p.json"]


def test_parameters_of_a_file(folder):
    whole = quality_with(*save(Formulation.RELEASED))
    row = read("out.csv")[0]
    spatial, temporal = (float(row[name]) for name in ADDED[:2])
    np.testing.assert_allclose(whole, -3.6 * spatial - 2.9 * temporal, rtol=1e-6)
    twice = quality_with(*save(Formulation.RELEASED, ws=-7.2, wt=-5.8))
    np.testing.assert_allclose(twice, 2 * whole, rtol=1e-6)


def test_the_formulation_is_that_of_the_file(folder, capsys):
    released = quality_with(*save(Formulation.RELEASED))
    assert released == quality_with(
        *save(Formulation.RELEASED), *formulation("released")
    )
    paper = quality_with(*save(Formulation.PAPER))
    assert paper == quality_with(*save(Formulation.PAPER), *formulation("paper"))
    assert abs(paper - released) > 1
    assert "paper, ws=-3.6, " in capsys.readouterr().out
    command = ["predict", "in.csv", "-o", "new.csv", *save(Formulation.PAPER)]
    assert main([*command, *formulation("released")]) == 2
    assert lines(capsys) == [
        "camojab: Invalid value for '--formulation': must be that of p.json, paper, "
        "got released. See 'camojab predict --help'."
    ]
    assert not Path("new.csv").exists()


def formulation(name):
    return ["--formulation", name]


def test_formulations_of_the_option_are_those_of_the_model():
    options = cli.predict.__annotations__["formulation"]
    choices = get_args(get_args(get_args(options)[0])[0])
    assert set(choices) == {member.value for member in Formulation}


def test_beta_of_a_row_takes_the_place_of_that_of_the_file(folder, capsys):
    at_half = quality_with(*save(Formulation.RELEASED, beta=0.5))
    write("in.csv", [ROW | {"beta": "0.5"}])
    assert quality_with(*save(Formulation.RELEASED)) == at_half
    assert "but beta of each row" in capsys.readouterr().out


@pytest.mark.parametrize(
    "content, message",
    [
        (None, "No such file or directory"),
        ("{", "not a parameter file: Expecting"),
        ("[]", "not a parameter file"),
        (json.dumps({"parameters": {}}), "'formulation'"),
        (
            json.dumps({"parameters": {"ws": 1}, "formulation": "released"}),
            "not a parameter file",
        ),
        (
            json.dumps({"parameters": {"ws": 1, "w": 2}, "formulation": "released"}),
            "unknown parameter 'w'",
        ),
        (json.dumps({"parameters": {}, "formulation": "new"}), "'new'"),
    ],
)
def test_files_that_hold_no_parameters(folder, capsys, content, message):
    if content is not None:
        Path("p.json").write_text(content)
    check_failure(capsys, "predict", message, "--parameters", "p.json")


# Data that cannot be used


def check_failure(capsys, command, *messages_and_options):
    """Exit status 1, the reason in one line, and nothing written."""
    message, *options = messages_and_options
    Path("out.csv").write_text("as it was")
    before = sorted(path.name for path in Path().iterdir())
    assert main([command, "in.csv", "-o", "out.csv", *options]) == 1
    (line,) = lines(capsys)
    assert line.startswith("camojab: ")
    assert message in line
    assert Path("out.csv").read_text() == "as it was"
    assert sorted(path.name for path in Path().iterdir()) == before


@pytest.mark.parametrize(
    "column, cell, message",
    [
        ("mean_luminance_cd_m2", "0", "must be finite and > 0 cd/m^2, got 0."),
        ("refresh_rate_hz", "-60", "must be finite and > 0 Hz, got -60."),
        ("velocity_deg_s", "-1e-9", "must be finite and >= 0 deg/s, got -1e-9."),
        ("persistence", "0", "must be in (0, 1], got 0."),
        ("persistence", "1.01", "must be in (0, 1], got 1.01."),
        ("ppd", "inf", "must be finite and > 0 px/deg, got inf."),
        ("ppd", "sixty", "must be finite and > 0 px/deg, got 'sixty'."),
        ("rate_x", "1.5", "must be in (0, 1], got 1.5."),
        ("rate_y", "", "must be in (0, 1], got ''."),
        ("mip_level", "nan", "must be finite and >= 0, got 'nan'."),
        ("mip_level", "1;\n2", r"must be finite and >= 0, got '1;\n2'."),
        ("beta", "0", "must be finite and > 0, got 0."),
        ("vrs", "2", "must be 0 or 1, got 2."),
        ("eye_blur", "yes", "must be 0 or 1, got 'yes'."),
        ("judder", "0.5", "must be 0 or 1, got 0.5."),
        ("texture", "gray.npy", "got 'gray.npy', which is no file."),
        ("texture", "", "got '', which is no file."),
        ("texture", "builtin:bricks", "one of builtin:brick, builtin:grass, "),
    ],
)
def test_a_bad_cell_is_named(folder, capsys, column, cell, message):
    good = ROW | {column: ROW.get(column, "1")}
    write("in.csv", [good, good, good | {column: cell}, good])
    check_failure(capsys, "predict", f"in.csv, line 4: `{column}` must be ")
    check_failure(capsys, "predict", message)


@pytest.mark.parametrize(
    "column, cell, message",
    [
        ("spatial_frequency_cpd", "-1", "must be finite and >= 0 cycles/deg, got -1."),
        ("temporal_frequency_hz", "x", "must be finite and >= 0 Hz, got 'x'."),
        ("luminance_cd_m2", "0", "must be finite and > 0 cd/m^2, got 0."),
    ],
)
def test_a_bad_cell_of_a_grating_is_named(folder, capsys, column, cell, message):
    write("in.csv", [GRATING, GRATING | {column: cell}])
    check_failure(capsys, "sensitivity", f"in.csv, line 3: `{column}` {message}")


def test_a_sensitivity_that_is_not_finite(folder, capsys):
    extreme = {"spatial_frequency_cpd": "1e-300", "temporal_frequency_hz": "1e300"}
    write("in.csv", [GRATING, GRATING | extreme])
    check_failure(capsys, "sensitivity", "line 3: `sensitivity` must be finite, got")


def test_lines_are_counted_as_an_editor_does(folder, capsys):
    rows = [ROW | {"note": "two\nlines"}, ROW | {"note": "", "ppd": "0"}]
    write("in.csv", rows)
    text = Path("in.csv").read_text()
    Path("in.csv").write_text(text.replace("\n", "\n\n", 1))
    check_failure(capsys, "predict", "line 5: `ppd`")


def test_every_problem_has_a_line_up_to_ten(folder, capsys):
    bad = ROW | {"rate_x": "0", "rate_y": "0"}
    for rows, said in ((5, 10), (6, 11)):
        write("in.csv", [bad] * rows)
        assert main(["predict", "in.csv", "-o", "out.csv"]) == 1
        printed = lines(capsys)
        assert len(printed) == said
        assert printed[0].startswith("camojab: in.csv, line 2: `rate_x`")
        assert printed[9].startswith("camojab: in.csv, line 6: `rate_y`")
    assert printed[10] == "camojab: 2 more problems."
    assert not Path("out.csv").exists()


@pytest.mark.parametrize("command, row", [("predict", ROW), ("sensitivity", GRATING)])
def test_missing_repeated_and_taken_columns(folder, capsys, command, row):
    for name in row:
        write("in.csv", [{k: v for k, v in row.items() if k != name}])
        check_failure(
            capsys, command, f"in.csv: the table must have the column `{name}`"
        )
    last = list(row)[-1]
    Path("in.csv").write_text(f"{','.join(row)},{last}\n")
    check_failure(capsys, command, f"must have each column once, got `{last}` twice.")
    taken = "quality_jnd" if command == "predict" else "sensitivity"
    write("in.csv", [row | {taken: "0"}])
    check_failure(capsys, command, f"must not have the column `{taken}`")


@pytest.mark.parametrize(
    "content, message",
    [
        (b"", "in.csv: must begin with the names of the columns."),
        (b"\n1,2\n", "in.csv: must begin with the names of the columns."),
        (
            b"texture,ppd\na\n",
            "in.csv, line 2: must have 2 cells, as the header, got 1.",
        ),
        (b"ppd\n1\n1,2\n", "in.csv, line 3: must have 1 cell, as the header, got 2."),
        (b'texture\n"a\n', "in.csv, line 2: must be CSV"),
        (b"texture\n\xff\xfe\n", "in.csv: must be text in UTF-8"),
    ],
)
def test_files_that_are_no_tables(folder, capsys, content, message):
    Path("in.csv").write_bytes(content)
    check_failure(capsys, "predict", message)


def test_files_that_are_not_there(folder, capsys):
    Path("in.csv").unlink()
    check_failure(capsys, "predict", "in.csv: No such file or directory.")
    Path("in.csv").mkdir()
    check_failure(capsys, "sensitivity", "in.csv: Is a directory.")


def test_an_output_that_is_a_folder_is_refused_before_the_work(folder, capsys):
    (folder / "out").mkdir()
    Path("in.csv").write_text(",".join(ROW) + "\n")
    assert main(["predict", "in.csv", "-o", "out"]) == 1
    assert lines(capsys) == [
        "camojab: out: must be a file to write, got a folder.",
    ]


# A command line that is wrong


@pytest.mark.parametrize(
    "argv, message",
    [
        ([], "Missing command"),
        (["solve"], "solve"),
        (["predict"], "Missing"),
        (["predict", "in.csv"], "--output"),
        (["predict", "in.csv", "-o", "out.csv", "--precision", "16"], "--precision"),
        (["predict", "in.csv", "-o", "out.csv", "--formulation", "x"], "'released'"),
        (["predict", "in.csv", "-o", "out.csv", "--encodin", "x"], "--encodin"),
        (["predict", "in.csv", "-o", "out.csv", "--encoding", "x"], "`encoding` must"),
        (["sensitivity", "a.csv", "b.csv", "-o", "out.csv"], "b.csv"),
        (["--verbose"], "Missing command"),
        (["--verbose", "predict", "in.csv", "-o", "out.csv"], "goes with --version"),
    ],
)
def test_wrong_command_lines(folder, capsys, argv, message):
    assert main(argv) == 2
    (line,) = lines(capsys)
    assert line.startswith("camojab: ") and message in line
    assert "See 'camojab" in line
    assert not Path("out.csv").exists()


# Interruption and defects


def test_an_interruption_leaves_nothing_behind(folder, capsys, monkeypatch):
    def interrupt(*args, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(Spectrum, "from_texture", interrupt)
    assert main(["predict", "in.csv", "-o", "out.csv"]) == 130
    assert sorted(path.name for path in Path().iterdir()) == ["grey.npy", "in.csv"]


def test_a_defect_keeps_its_traceback(folder, monkeypatch):
    def defect(*args, **options):
        raise ZeroDivisionError

    monkeypatch.setattr(Spectrum, "from_texture", defect)
    with pytest.raises(ZeroDivisionError):
        main(["predict", "in.csv", "-o", "out.csv"])
    assert not Path("out.csv").exists()


# In a process of its own


def process(*argv, after=""):
    code = f"import sys\nfrom camojab.cli import main\nstatus = main()\n{after}"
    return subprocess.run(
        [sys.executable, "-c", f"{code}\nsys.exit(status)", *argv],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


@pytest.mark.parametrize(
    "argv",
    [["--help"], ["predict", "--help"], ["sensitivity", "--help"], ["--version"]],
)
def test_help_and_version_import_nothing_heavy(argv):
    done = process(*argv, after="print('modules:', *sys.modules)")
    assert done.returncode == 0, done.stderr
    text, modules = done.stdout.split("modules:")
    assert "camojab" in text
    heavy = {"jax", "numpy", "pandas", "scipy", "colour", "skimage", "matplotlib"}
    assert heavy & set(modules.split()) == set()


def test_version():
    assert process("--version").stdout == f"camojab {version('alsarr')}\n"
    assert process("--verbose", "--version").stdout.startswith("camojab ")
    (line,) = process("--version", "--verbose").stdout.splitlines()
    names = ["camojab", "python", "numpy", "jax", "equinox", "optimistix"]
    assert [part.split()[0] for part in line.split(", ")[:6]] == names
    assert f"jax {jax.__version__}, " in line
    assert ", x64 off by default, device " in line


def test_the_whole_way_and_an_error(folder):
    done = process("predict", "in.csv", "-o", "out.csv", "--precision", "32")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert np.isfinite(numbers(read("out.csv"), "quality_jnd")).all()
    write("in.csv", [ROW | {"ppd": "0"}])
    done = process("predict", "in.csv", "-o", "new.csv")
    assert done.returncode == 1
    assert done.stderr == (
        "camojab: in.csv, line 2: `ppd` must be finite and > 0 px/deg, got 0.\n"
    )
    assert not Path("new.csv").exists()

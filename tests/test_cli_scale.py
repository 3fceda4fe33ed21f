"""`camojab scale`: votes to JND, on the command line."""

import csv
import hashlib
import io
import json
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import jax
import numpy as np
import pandas as pd
import pytest

from camojab import datasets, votes
from camojab._results import check_folder, save, to_csv
from camojab._scale_command import _beside_published, _resampling_note
from camojab._scale_sources import own_votes, SOURCES
from camojab.cli import main


# The command computes in double precision whatever the lane.
pytestmark = pytest.mark.float64

FILES = ["report.html", "scale.csv", "scale.json"]
QUALITY = {"best": 1.0, "middle": 0.0, "worst": -1.5}


def cast(observers=6, blocks=("day", "night"), repeats=3):
    """Votes of observers who agree on a scale, but not always."""
    generator = np.random.default_rng(20)
    names = list(QUALITY)
    rows = []
    for observer in range(observers):
        for block in blocks:
            for _ in range(repeats):
                for a, b in (
                    ("best", "middle"),
                    ("worst", "best"),
                    (names[1], "worst"),
                ):
                    lead = QUALITY[a] - QUALITY[b]
                    won = lead / votes._simulation.SIGMA + generator.normal() > 0
                    rows.append([f"o{observer}", block, a, b, int(won)])
    return rows


def write(path, rows):
    with Path(path).open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["observer", "block", "condition_a", "condition_b", "a_preferred"]
        )
        writer.writerows(rows)


@pytest.fixture(scope="module")
def scaled(tmp_path_factory):
    """The folder that one run wrote, with the votes beside it."""
    folder = tmp_path_factory.mktemp("scale")
    write(folder / "votes.csv", cast())
    command = ["scale", "--votes", str(folder / "votes.csv"), "--by", "block"]
    options = ["--reference", "middle", "--bootstrap", "40", "--seed", "7"]
    assert main([*command, *options, "-o", str(folder / "out" / "scale")]) == 0
    return folder / "out" / "scale"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write("votes.csv", cast())
    return tmp_path


def floats(rows, column):
    return [float(row[column] or "nan") for row in rows]


def strict(path):
    """JSON as its standard has it, in which no number is NaN."""

    def refuse(name):
        raise AssertionError(name)

    return json.loads(Path(path).read_text(), parse_constant=refuse)


def library(folder):
    """What the library finds for the same votes."""
    table = votes.read_votes(folder.parents[1] / "votes.csv")
    return table, {"by": ["block"], "reference": "middle"}


def test_files_and_no_others(scaled):
    assert sorted(path.name for path in scaled.iterdir()) == FILES


def test_numbers_are_the_library_s_to_the_last_digit(scaled):
    table, options = library(scaled)
    found = votes.bootstrap(table, key=jax.random.key(7), resamples=40, **options)
    with (scaled / "scale.csv").open(newline="") as file:
        written = list(csv.DictReader(file))
    assert list(written[0]) == list(found.table)
    for name in found.table:
        if name in ("block", "condition"):
            assert [row[name] for row in written] == list(found.table[name])
        else:
            np.testing.assert_array_equal(floats(written, name), found.table[name])
    document = strict(scaled / "scale.json")
    pd.testing.assert_frame_equal(
        pd.DataFrame(document["scale"]), found.table, check_exact=True
    )
    groups = votes.scale_groups(table, **options).groups
    pd.testing.assert_frame_equal(
        pd.DataFrame(document["groups"]), groups, check_dtype=False, check_exact=True
    )
    outliers = votes.outliers(table, by=["block"])
    pd.testing.assert_frame_equal(
        pd.DataFrame(document["outliers"]),
        outliers.assign(suspicious=outliers["distance"] > 1),
        check_exact=True,
    )


def test_residuals_are_of_the_group_and_the_conditions_they_name(scaled):
    table, _ = library(scaled)
    document = strict(scaled / "scale.json")
    assert list(document["residuals_jnd"]) == ["block day", "block night"]
    jnd = pd.DataFrame(document["scale"])
    for block in ("day", "night"):
        matrix = document["residuals_jnd"][f"block {block}"]
        own = jnd[jnd["block"] == block]
        assert matrix["conditions"] == list(own["condition"])
        wins = votes.count(table[table["block"] == block], matrix["conditions"])
        expected = votes.residuals(wins, own["quality_jnd"].to_numpy())
        got = np.array(matrix["rows"], float)
        np.testing.assert_array_equal(got, np.asarray(expected))
        assert np.isfinite(got).sum() >= 4


def test_provenance(scaled):
    document = strict(scaled / "scale.json")
    assert document["schema"] == "camojab-scale/1"
    assert document["camojab"] == version("alsarr")
    assert document["versions"] == {name: version(name) for name in ("jax", "numpy")}
    assert document["seed"] == 7 and document["resamples"] == 40
    assert document["prior"] == "none" and document["reference"] == "middle"
    path = scaled.parents[1] / "votes.csv"
    sha = hashlib.sha256(path.read_bytes()).hexdigest()
    assert document["sha256"] == {str(path): sha}


def test_report_stands_alone(scaled):
    page = (scaled / "report.html").read_text()
    assert "http" not in page
    assert not re.search(r"(src|href)\s*=\s*['\"](?!data:)", page)
    assert page.count("data:image/png;base64,") == 3
    assert "<b>simulated</b>" not in page
    for heading in ("Just-noticeable differences", "Observers", "Goodness of fit"):
        assert f"<h2>{heading}</h2>" in page
    assert f"camojab {version('alsarr')}, jax {version('jax')}" in page


def run(*options):
    return main(["scale", "--votes", "votes.csv", "-o", "out", *options])


def test_what_is_printed(here, capsys):
    assert run("--by", "block", "--bootstrap", "0", "--reference", "middle") == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    lines = captured.out.splitlines()
    assert lines[0] == "JND of votes.csv"
    assert lines[2].split() == ["block", "condition", "votes", "quality", "[JND]"]
    table = pd.read_csv("out/scale.csv")
    for line, (_, row) in zip(lines[3:9], table.iterrows(), strict=True):
        shown = f"{row['quality_jnd']:.3f}".replace("-0.000", "0.000")
        assert line.split() == [row["block"], row["condition"], "36", shown]
    assert "No intervals: none were asked for (--bootstrap 0)." in lines
    assert lines[-1] == "written: out/scale.json, out/scale.csv, out/report.html"
    assert list(table) == ["block", "condition", "votes", "quality_jnd"]


def test_the_same_seed_gives_the_same_numbers_and_another_others(here, scaled):
    options = ["--by", "block", "--reference", "middle", "--bootstrap", "40"]
    found = []
    for seed in ("7", "8"):
        assert run(*options, "--seed", seed) == 0
        found.append(Path("out/scale.csv").read_bytes())
    assert found[0] == (scaled / "scale.csv").read_bytes() != found[1]


def test_without_groups_all_votes_are_of_one_scale(here):
    assert run("--bootstrap", "0") == 0
    document = strict("out/scale.json")
    assert [row["condition"] for row in document["scale"]] == sorted(QUALITY)
    assert sum(row["quality_jnd"] for row in document["scale"]) == pytest.approx(
        0, abs=1e-12
    )
    assert list(document["residuals_jnd"]) == ["all votes"]


def test_one_observer_has_no_intervals_and_is_told_why(here, capsys):
    write("votes.csv", [["x", *row[1:]] for row in cast()])
    assert run("--by", "block") == 0
    out = capsys.readouterr().out
    assert "No intervals and no outlier scores: " in out and "only 'x'" in out
    document = strict("out/scale.json")
    assert document["outliers"] is None and document["resamples"] == 0
    assert "low_jnd" not in document["scale"][0]
    page = Path("out/report.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert "only &#x27;x&#x27;" in page


def test_resamples_that_cannot_be_scaled_are_told(here, capsys):
    """Only one observer voted against the majority: without him all are unanimous."""
    rows = [["o0", "day", "a", "b", int(i < 9)] for i in range(10)]
    rows += [[f"o{k}", "day", "a", "b", 1] for k in (1, 2)]
    write("votes.csv", rows)
    assert run("--bootstrap", "30") == 0
    out = capsys.readouterr().out
    assert "of 30 resamples only" in out and "--prior bounded" in out
    table = pd.DataFrame({"resamples": [30, 30]})
    assert "percentiles of 30 bootstraps" in _resampling_note(table, 30)


def test_shipped_votes_are_labelled_as_simulated(here):
    shipped = datasets._simulated.shipped("simulated_votes.csv")
    assert SOURCES["simulated"]().simulated == own_votes(shipped).simulated != ""
    assert own_votes(Path("votes.csv")).simulated == ""


# Published votes


def test_published_jnd_of_jindal2021(real_data, tmp_path, capsys):
    real_data(
        "jindal2021/Experiment_Data/vrs_exp_data.csv",
        "jindal2021/Experiment_Data/vrs_exp_data_jnd.mat",
    )
    command = ["scale", "--data", "jindal2021", "--bootstrap", "0"]
    assert main([*command, "-o", str(tmp_path)]) == 0
    table = pd.read_csv(tmp_path / "scale.csv")
    assert len(table) == 81
    np.testing.assert_allclose(table["quality_jnd"], table["published_jnd"], atol=1e-3)
    assert "met to 0.001 JND in 9 of 9 groups" in capsys.readouterr().out
    document = strict(tmp_path / "scale.json")
    assert document["prior"] == "bounded" and document["reference"] == "full"


@pytest.mark.parametrize(
    "by, reference, beside",
    [
        (("block",), "full", True),
        ((), "full", False),
        (("block", "more"), "full", False),
        (("block",), "grass 2x1", False),
        (("block",), None, False),
    ],
)
def test_published_jnd_are_for_their_own_groups_and_reference(by, reference, beside):
    names = {"block": "PC", "more": 1, "condition": ["full", "grass 2x1", "new"]}
    table = pd.DataFrame(names).assign(quality_jnd=[0.0, -1.0, -2.0])
    published = pd.DataFrame(
        {
            "block": "PC",
            "condition": ["grass 2x1", "full"],
            "published_jnd": [-1.2, 0.0],
        }
    )
    found, notes = _beside_published(table, published, by, reference)
    assert ("published_jnd" in found) == beside == bool(notes)
    if beside:
        np.testing.assert_array_equal(found["published_jnd"], [0.0, -1.2, np.nan])
        assert notes == [
            "Published JND: met to 0.001 JND in 0 of 1 groups; the largest difference "
            "is 0.2 JND."
        ]


def test_published_votes_without_observers(real_data, tmp_path, capsys):
    """The prior of the published JND, which are met, takes half a minute."""
    real_data("denes2020/data/pairwise_comparison_matrices.mat")
    real_data("denes2020/data/exp1_scaled_results.csv")
    command = ["scale", "--data", "denes2020", "--prior", "none"]
    assert main([*command, "-o", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "met to 0.001 JND in 0 of 6 groups" in out
    assert "No intervals and no outlier scores" in out
    table = pd.read_csv(tmp_path / "scale.csv")
    published = datasets.denes2020_exp1_all()["quality_jnd"]
    assert sorted(table["published_jnd"]) == pytest.approx(sorted(published))
    # More refresh rate, more quality; a prior takes from the differences.
    assert table["quality_jnd"].corr(table["published_jnd"]) > 0.95
    assert table["quality_jnd"].max() > table["published_jnd"].max()


@pytest.mark.parametrize("name", ["jindal2021", "denes2020"])
def test_every_file_that_is_read_is_recorded(real_data, monkeypatch, name):
    folder = {"jindal2021": "Experiment_Data/vrs_exp_data.csv"}
    real_data(
        f"{name}/{folder.get(name, 'data/pairwise_comparison_matrices.mat')}",
        "jindal2021/Experiment_Data/vrs_exp_data_jnd.mat",
        "denes2020/data/exp1_scaled_results.csv",
    )
    asked, fetch = [], datasets.fetch

    def record(file):
        asked.append(file)
        return fetch(file)

    for module in (datasets._jindal2021, datasets._denes2020):
        monkeypatch.setattr(module, "fetch", record)
    assert set(SOURCES[name]().files) == set(asked)


# Data and command lines that are wrong


def failure(capsys, *argv, status=1):
    """The reason, in one line; what was there before is there still."""
    Path("out").mkdir(exist_ok=True)
    Path("out/scale.csv").write_text("as it was")
    capsys.readouterr()
    assert main(["scale", *argv]) == status
    captured = capsys.readouterr()
    assert captured.out == ""
    assert [path.name for path in Path("out").iterdir()] == ["scale.csv"]
    assert Path("out/scale.csv").read_text() == "as it was"
    (line,) = captured.err.splitlines()
    return line


OWN = ["--votes", "votes.csv", "-o", "out"]


@pytest.mark.parametrize(
    "options, message",
    [
        (["--by", "blok"], "`--by` must name different columns of block, got 'blok'."),
        (["--by", "block,block"], "`--by` must name different columns of block, got"),
        (["--by", "observer"], "`--by` must name different columns of block, got"),
        (["--by", "block,"], "`--by` must name different columns of block, got ''."),
        (["--reference", "none"], "`--reference` must be a condition"),
    ],
)
def test_options_that_do_not_suit_the_votes(here, capsys, options, message):
    assert message in failure(capsys, *OWN, *options)


def test_a_column_of_the_result_tells_no_groups_apart(here, capsys):
    text = Path("votes.csv").read_text().replace("block", "votes", 1)
    Path("votes.csv").write_text(text)
    line = failure(capsys, *OWN, "--by", "votes")
    assert "`--by` must not name 'votes', a column of the result." in line


def test_unanimous_votes_and_what_helps(here, capsys):
    write("votes.csv", [[f"o{i}", "day", "a", "b", 1] for i in range(4)])
    assert "infinite without a prior" in failure(capsys, *OWN)
    line = failure(capsys, *OWN, "--prior", "gaussian")
    assert "`--prior bounded`" in line
    assert main(["scale", *OWN, "--prior", "bounded", "--bootstrap", "0"]) == 0


def test_conditions_that_nothing_connects(here, capsys):
    rows = [["o", "day", a, b, i] for a, b in ("ab", "cd") for i in (0, 1)]
    write("votes.csv", rows)
    assert "must connect all conditions by comparisons" in failure(capsys, *OWN)


def test_every_problem_of_the_votes_has_a_line(here, capsys):
    write("votes.csv", [["o", "day", "a", "a", 1], ["", "day", "a", "b", 2]])
    assert main(["scale", *OWN]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(": ")[2].partition(":")[0] for line in lines] == [
        "votes.csv, line 2",
        "votes.csv, line 3",
        "votes.csv, line 3",
    ]
    assert not Path("out").exists()


def test_votes_that_are_not_there(here, capsys):
    line = failure(capsys, "--votes", "vote.csv", "-o", "out")
    assert line == "camojab: vote.csv: No such file or directory."


def test_published_votes_that_are_not_there(here, capsys, monkeypatch):
    monkeypatch.setenv("CAMOJAB_DATA_DIR", str(here))
    line = failure(capsys, "--data", "jindal2021", "-o", "out")
    assert "CAMOJAB_DATA_DIR" in line


@pytest.mark.parametrize(
    "argv, message",
    [
        (["-o", "out"], "--votes or --data"),
        ([*OWN, "--data", "denes2020"], "--votes or --data"),
        (["--votes", "votes.csv"], "--output"),
        ([*OWN, "--bootstrap", "1"], "must be 0 or >= 2."),
        ([*OWN, "--bootstrap", "-1"], "--bootstrap"),
        ([*OWN, "--seed", "-1"], "--seed"),
        ([*OWN, "--prior", "normal"], "'bounded'"),
        (["--data", "jindal2020", "-o", "out"], "'jindal2021'"),
    ],
)
def test_wrong_command_lines(here, capsys, argv, message):
    line = failure(capsys, *argv, status=2)
    assert message in line and line.endswith("See 'camojab scale --help'.")


# The folder


def test_a_folder_that_cannot_be_is_refused_before_the_work(here, capsys):
    Path("file").write_text("mine")
    for output in ("file", "file/below", "file/far/below"):
        assert main(["scale", "--votes", "absent.csv", "-o", output]) == 1
        error = capsys.readouterr().err
        assert "file: must be a folder to write into." in error
    assert Path("file").read_text() == "mine"
    Path("out/scale.json").mkdir(parents=True)
    assert main(["scale", "--votes", "absent.csv", "-o", "out"]) == 1
    error = capsys.readouterr().err
    assert "out/scale.json: must be a file to write, got a folder." in error


def test_a_new_folder_may_be_deep_and_an_old_one_keeps_other_files(here):
    check_folder(Path("a/b/c"), FILES)
    save(Path("a/b/c"), {"one": "1"})
    save(Path("a/b/c"), {"one": "2", "two": "3\n"})
    found = {path.name: path.read_text() for path in Path("a/b/c").iterdir()}
    assert found == {"one": "2", "two": "3\n"}


def test_all_files_are_renamed_or_none(here):
    save(here / "x", {"one": "old"})
    with pytest.raises(UnicodeEncodeError):
        save(here / "x", {"one": "new", "two": "\ud800"})
    assert {p.name: p.read_text() for p in (here / "x").iterdir()} == {"one": "old"}


def test_a_table_comes_back_exactly():
    # For its side effect: it shortens how NumPy and pandas print numbers.
    import colour  # noqa: F401

    numbers, names = [0.1, 1 / 3, np.nan, 1e-300], ['a, "b"', "", "c\nd", "0.1"]
    text = to_csv(pd.DataFrame({"x": numbers, "name": names, "n": range(4)}))
    rows = list(csv.DictReader(io.StringIO(text, newline="")))
    assert [row["name"] for row in rows] == names
    assert [row["n"] for row in rows] == ["0", "1", "2", "3"]
    np.testing.assert_array_equal(floats(rows, "x"), numbers)


@pytest.mark.parametrize("command", ["scale", "compare", "validate"])
def test_help_imports_nothing_heavy(command):
    code = (
        "import sys; from camojab.cli import main; status = main(); "
        "print('modules:', *sys.modules); sys.exit(status)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, command, "--help"],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    text, modules = done.stdout.split("modules:")
    assert "report.html" in text
    heavy = {"jax", "numpy", "pandas", "scipy", "colour", "skimage", "matplotlib"}
    assert heavy & set(modules.split()) == set()

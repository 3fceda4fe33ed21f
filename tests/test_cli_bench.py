"""`camojab bench`, on few conditions of few cases, and its figure."""

import csv
import io
import json
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import reference
from camojab import _bench, _bench_command, datasets, Exact, Formulation, Pooled
from camojab._shipped import shipped
from camojab.cli import main
from camojab.plotting import error_and_throughput


# The command enters its precisions itself, so that both lanes would do the same.
pytestmark = pytest.mark.float64

GOLDEN = Path(__file__).parent / "golden" / "model_dst.csv"
CASES = [
    _bench.Case(Formulation.RELEASED, "64", Exact()),
    _bench.Case(Formulation.PAPER, "64", Exact()),
    _bench.Case(Formulation.RELEASED, "32", Exact()),
    _bench.Case(Formulation.RELEASED, "32", Pooled(500)),
]
NAMES = ["formulation", "precision", "fidelity"]


def few_conditions():
    table = pd.read_csv(shipped("bench_conditions.csv"))
    some = table.groupby("texture").head(4)
    return pd.concat([some, table[table["beta"] == 2]]).drop_duplicates()


def two_textures():
    built_in = datasets.builtin_textures()
    arrays = {name: built_in[name] for name in ("grass", "noise")}
    return _bench_command._Textures(arrays, "two", {}, "Two textures.")


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """The folder that the command wrote, and what it printed."""
    folder = tmp_path_factory.mktemp("bench") / "new"
    printed = io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.stdout", printed)
        patch.setattr(_bench_command, "all_cases", lambda cells: CASES)
        patch.setattr(_bench_command, "BATCHES", (1, 10))
        patch.setattr(_bench_command, "_conditions", few_conditions)
        patch.setattr(_bench_command, "_textures", two_textures)
        # No time but for what is always measured.
        assert main(["bench", "--seconds", "0", "--seed", "3", "-o", str(folder)]) == 0
    return folder, printed.getvalue()


@pytest.fixture(scope="module")
def document(out):
    def refuse(name):
        raise AssertionError(name)

    return json.loads((out[0] / "bench.json").read_text(), parse_constant=refuse)


def test_files_and_no_others(out):
    names = sorted(path.name for path in out[0].iterdir())
    assert names == ["bench.csv", "bench.json", "bench.png"]
    assert (out[0] / "bench.png").read_bytes().startswith(b"\x89PNG")


def test_provenance(document):
    assert document["schema"] == "camojab-bench/1"
    assert document["camojab"] == version("alsarr")
    assert document["seed"] == 3
    assert set(document["sha256"]) == {"bench_conditions.csv"}
    assert document["versions"]["jax"] == version("jax")
    assert document["machine"]["jaxlib"] == version("jaxlib")
    assert document["machine"]["cpus"] >= 1
    assert document["machine"]["process_peak_mib"] > 100


def test_every_case_has_an_error_and_times(document):
    cases = [list(case.names().values()) for case in CASES]
    for key in ("rungs", "errors", "times"):
        named = [[row[name] for name in NAMES] for row in document[key]]
        assert sorted(named) == sorted(cases)
    for row in document["times"]:
        assert row["compile_s"] > 0 and row["memory_mib"] > 0 and row["repeats"] >= 3
        assert row["condition_s"] == pytest.approx(row["run_s"] / row["batch"])


def test_batches_left_out_are_named(document, out):
    assert len(document["left_out"]) == len(CASES)
    assert "released float32 exact at 1" in document["left_out"]
    assert f"There was no time (--seconds 0) for {len(CASES)} batches" in out[1]


def test_errors(document):
    rows = {tuple(row[name] for name in NAMES): row for row in document["errors"]}
    exact = rows["released", "float64", "exact"]
    assert exact["largest_jnd"] == exact["difference_jnd"] == 0
    assert exact["worst"] == ""
    single = rows["released", "float32", "exact"]
    assert 0 < single["largest_jnd"] < 1e-3
    pooled = rows["released", "float32", "500 cells"]
    assert 1e-3 < pooled["largest_jnd"] < 0.5
    assert pooled["median_jnd"] <= pooled["percentile_99_jnd"]
    assert pooled["percentile_99_jnd"] <= pooled["largest_jnd"]
    assert 0 < pooled["difference_jnd"] <= 2 * pooled["largest_jnd"]
    assert pooled["worst"].split(",")[0] in ("grass", "noise")
    assert " deg/s" in pooled["worst"] and " Hz" in pooled["worst"]
    # The rung's own estimate is not optimistic by more than a factor of two.
    assert pooled["estimate_jnd"] > 0.5 * pooled["largest_of_rates_jnd"]
    # The paper's formulation has no conditions of the table, but two textures at four
    # rates under eight conditions.
    paper = rows["paper", "float64", "exact"]
    assert paper["conditions"] == 64 and paper["largest_of_table_jnd"] is None


def test_the_transcription_is_the_peer(document, out):
    peer = document["peer"]
    assert peer["error_jnd"] < 1e-9
    for row in document["rungs"]:
        if row["formulation"] == "paper":
            assert row["times_peer"] is None
        else:
            ratio = row["conditions_per_s"] * peer["condition_s"]
            assert row["times_peer"] == pytest.approx(ratio)
    assert "NumPy transcription: " in out[1]


def test_the_front_is_of_its_own_formulation(document):
    for row in document["rungs"]:
        beaten = any(
            other["formulation"] == row["formulation"]
            and other["error_jnd"] <= row["error_jnd"]
            and other["conditions_per_s"] > row["conditions_per_s"]
            for other in document["rungs"]
        )
        assert row["front"] == ("" if beaten else "yes")


def test_csv_is_the_table_of_rungs(document, out):
    with (out[0] / "bench.csv").open(newline="") as file:
        written = list(csv.DictReader(file))
    rows = document["rungs"]
    assert [list(row) for row in rows] == [list(row) for row in written]
    for row, texts in zip(rows, written, strict=True):
        for column, value in row.items():
            assert texts[column] == ("" if value is None else str(value))


def test_conditions_are_those_of_the_golden_values():
    ours, golden = (
        list(csv.reader(path.read_text().splitlines()))
        for path in (shipped("bench_conditions.csv"), GOLDEN)
    )
    assert golden[0][-2:] == ["E_s", "E_t"]
    assert ours == [row[:-2] for row in golden]


def test_every_condition_of_the_table_is_in_a_grid_once():
    table = pd.read_csv(shipped("bench_conditions.csv"))
    names = list(dict.fromkeys(table["texture"]))
    grids = _bench.grids(table, names, 0.36, seed=0)
    shapes = {grid.table.shape for grid in grids[Formulation.RELEASED].values()}
    assert len(shapes) == 1
    columns = [*_bench._SETTING, *_bench._VIEW, "eye_blur", "judder"]
    for name, grid in grids[Formulation.RELEASED].items():
        told = grid.table | grid.tall
        assert not (grid.table & grid.tall).any() and not (told & grid.rates).any()
        found = np.stack([grid.columns[column][told] for column in columns], axis=1)
        rows = table[table["texture"] == name][columns].to_numpy(float)
        order = lambda x: x[np.lexsort(x.T)]
        np.testing.assert_array_equal(order(found), order(rows))
        assert (grid.columns["beta"][grid.tall] >= 1).all()
        # Of one setting in each line, as pooling has it.
        for column in _bench._SETTING:
            x = grid.columns[column]
            np.testing.assert_array_equal(x, np.repeat(x[:, :1], x.shape[1], axis=1))


def test_the_last_settings_differ_in_the_rate_alone():
    table = few_conditions()
    grids = _bench.grids(table, ["grass"], 0.36, seed=1)
    grid = grids[Formulation.PAPER]["grass"]
    assert grid.rates.all()
    for name, x in grid.columns.items():
        same = np.array_equal(x, np.broadcast_to(x[:1], x.shape))
        assert same == (name not in ("rate_x", "rate_y"))
    again = _bench.grids(table, ["grass"], 0.36, seed=1)[Formulation.PAPER]["grass"]
    np.testing.assert_array_equal(again.columns["ppd"], grid.columns["ppd"])


def test_batches_that_there_is_time_for(monkeypatch):
    case = CASES[-1]
    clock = _bench.Clock(np.ones((4, 4)), 0)
    monkeypatch.setattr(clock, "pool", lambda case: None)
    evaluated = lambda case, batch: {
        "batch": batch,
        "compile_s": 1.0,
        "condition_s": 1.0,
    }
    monkeypatch.setattr(clock, "evaluate", evaluated)
    monkeypatch.setattr(_bench.time, "monotonic", lambda: 1000.0)
    sizes = (1, 10, 100, 1000)
    nothing = lambda stage, done, total: None
    rows, left_out = _bench.sweep(clock, [case], sizes, 1050.0, nothing)
    # 1000 always; 1 + 4 and 1 + 40 seconds fit into 50, 1 + 400 do not.
    assert [row["batch"] for row in rows] == [1000, 1, 10]
    assert left_out == ["released float32 500 cells at 100"]


def test_published_textures_that_are_not_there(tmp_path, monkeypatch):
    monkeypatch.setenv("CAMOJAB_DATA_DIR", str(tmp_path))
    found = _bench_command._textures()
    assert found.source == "built-in textures" and not found.files
    assert "brick for marrr_checkerboard" in found.note
    assert "CAMOJAB_DATA_DIR" in found.note
    np.testing.assert_array_equal(
        found.arrays["noise"], datasets.builtin_textures()["noise"]
    )


def test_published_textures(real_data):
    real_data("jindal2021/Experiment_Data/vrs_exp_stimulus.mat")
    found = _bench_command._textures()
    assert found.source == "textures of Jindal et al. 2021"
    table = pd.read_csv(shipped("bench_conditions.csv"))
    assert set(found.arrays) == set(table["texture"])


def test_without_a_checkout_there_is_no_peer(tmp_path, monkeypatch):
    installed = tmp_path / "camojab" / "_bench_command.py"
    monkeypatch.setattr(_bench_command, "__file__", str(installed))
    found, note = _bench_command._beside(two_textures(), {}, {}, None)
    assert found is None
    assert "tests/reference.py" in note and "checkout" in note


def test_the_peer_is_called_with_its_own_arguments():
    texture = {"grass": datasets.builtin_textures()["grass"]}
    grid = _bench.grids(few_conditions(), list(texture), 0.36, 0)[Formulation.RELEASED]
    wrong = {"grass": np.zeros(grid["grass"].table.shape)}
    stages = []
    found = _bench.peer(reference, texture, grid, wrong, lambda *s: stages.append(s))
    # Against zeros the error is the quality itself.
    assert found["error_jnd"] > 0.1 and found["condition_s"] > 0
    assert stages == [("peer", 1, 1)]


def test_an_output_that_is_a_file_is_refused_before_the_work(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("mine")
    assert main(["bench", "-o", "file"]) == 1
    assert "file: must be a folder to write into." in capsys.readouterr().err
    assert Path("file").read_text() == "mine"


@pytest.mark.parametrize("option", ["--seconds", "--seed"])
def test_wrong_command_lines(option, capsys):
    assert main(["bench", "-o", "x", option, "-1"]) == 2
    assert f"'{option}'" in capsys.readouterr().err


def test_an_interruption_leaves_nothing_behind(tmp_path, monkeypatch):
    def interrupted(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr(_bench_command, "_textures", two_textures)
    monkeypatch.setattr(_bench, "quality", interrupted)
    monkeypatch.setattr(_bench_command, "errors", interrupted)
    assert main(["bench", "-o", str(tmp_path / "out")]) == 130
    assert not (tmp_path / "out").exists()


# ---- the figure


def points(axis):
    return {line.get_label(): line.get_xydata() for line in axis.lines}


def rungs(**columns):
    table = pd.DataFrame(
        {
            "formulation": ["released"] * 3 + ["paper"],
            "precision": ["float64", "float32", "float32", "float64"],
            "fidelity": ["exact", "exact", "500 cells", "exact"],
            "error_jnd": [0.0, 1e-5, 0.02, 0.0],
            "conditions_per_s": [500.0, 1500.0, 1e6, 40.0],
            "front": ["yes", "yes", "yes", "yes"],
        }
    )
    return table.assign(**columns)


def test_figure():
    figure = error_and_throughput(rungs())
    figure.savefig(io.BytesIO(), format="png", dpi=40)
    released, paper = figure.axes
    assert released.get_title() == "formulation: released"
    assert released.get_xscale() == released.get_yscale() == "log"
    shown = points(released)
    np.testing.assert_allclose(shown["float32"], [[1500, 1e-5], [1e6, 0.02]])
    # What has no logarithm stands a decade below what has.
    np.testing.assert_allclose(shown["float64"], [[500, 1e-6]])
    front = shown["none more accurate and faster"]
    np.testing.assert_allclose(front[:, 0], [500, 1500, 1e6])
    labels = [text.get_text() for text in released.texts]
    assert sorted(labels) == ["500", "exact", "exact"]
    named = dict(zip(released.get_yticks(), released.get_yticklabels(), strict=True))
    assert named[min(named)].get_text() == "0"
    assert len(paper.texts) == 1
    first = released.lines[1].get_color(), released.lines[2].get_color()
    assert first[0] != first[1]


def test_figure_of_what_is_off_the_front():
    figure = error_and_throughput(rungs(front=["yes", "", "yes", "yes"]))
    front = points(figure.axes[0])["none more accurate and faster"]
    np.testing.assert_allclose(front[:, 0], [500, 1e6])


def test_figure_of_exact_values_alone():
    table = rungs()
    figure = error_and_throughput(table[table["error_jnd"] == 0])
    assert len(figure.axes) == 2
    figure.savefig(io.BytesIO(), format="png", dpi=40)

"""The main job through the command line, on built-in and on the authors' data."""

import dataclasses
import json
import re
from pathlib import Path

import jax
import numpy as np
import pytest

from alsarr import RATES
from alsarr._inputs import jindal2021_inputs
from alsarr._report import agreement, fit_rows
from alsarr._run import run
from alsarr._stages import digest, Stages
from alsarr.cli import main
from alsarr.export import read_rates_bin
from alsarr.solve import greedy_jindal2021
from alsarr.tables import load_tables, Scene
from camojab import load_parameters


FILES = ["parameters.json", "rates.bin", "rates.png", "report.html", "tables.json"]
GOLDEN = Path(__file__).parents[1] / "golden" / "knapsack_scifi.npz"


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    """One run of the built-in job: the folder it wrote."""
    out = tmp_path_factory.mktemp("job") / "out"
    assert main(["run", "-o", str(out)]) == 0
    return out


def bytes_of(folder):
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir())}


def test_writes_its_files_and_no_others(job):
    assert sorted(p.name for p in job.iterdir()) == sorted([*FILES, "run.json"])


def test_map_fits_the_budget_and_is_the_one_in_the_record(job):
    rate = read_rates_bin(job / "rates.bin", rows=68, columns=120)
    cost = RATES.cost[rate].sum()
    assert 0.24 < cost / (256 * rate.size) <= 0.25
    found = json.loads((job / "run.json").read_text())["rate map"]["result"]
    assert found["cost"] == cost
    # The tables were made for all that the frame shows.
    assert found["outside"] == 0
    shares = np.bincount(rate.ravel(), minlength=7) / rate.size
    np.testing.assert_allclose(list(found["shares"].values()), shares, rtol=1e-12)


def test_constants_and_tables_load(job):
    parameters, _ = load_parameters(job / "parameters.json")
    assert parameters.ws < 0 and parameters.wt < 0 and 0.2 < parameters.beta < 0.5
    tables = load_tables(job / "tables.json")
    # Of 30 pairs of texture and mip level 18 occur in the frame.
    assert tables.coefficients.shape == (18, 7, 2, 10)
    assert tables.median_error < 0.1


def test_report_stands_alone_and_says_simulated(job):
    page = (job / "report.html").read_text()
    assert not re.search(r"(src|href)\s*=\s*['\"](?!data:)", page)
    assert "http" not in page
    assert page.count("data:image/png;base64,") == 4
    assert "<b>simulated</b>" in page and "parameters: ws=" in page


def test_second_run_does_nothing_and_a_change_only_what_follows(job, capsys):
    before = bytes_of(job)
    assert main(["run", "-o", str(job)]) == 0
    assert "computed: nothing" in capsys.readouterr().out
    assert bytes_of(job) == before

    assert main(["run", "-o", str(job), "--budget", "0.5"]) == 0
    assert "computed: rate map, report;" in capsys.readouterr().out
    after = bytes_of(job)
    same = {name for name in before if before[name] == after[name]}
    assert same == {"parameters.json", "tables.json"}

    assert main(["run", "-o", str(job)]) == 0
    capsys.readouterr()
    assert bytes_of(job) == before


@pytest.mark.parametrize("budget", ["0", "1.5", "nan", "-1"])
def test_bad_budget_is_one_line(tmp_path, capsys, budget):
    out = tmp_path / "out"
    assert main(["run", "-o", str(out), f"--budget={budget}"]) == 1
    error = capsys.readouterr().err
    assert error == f"alsarr: `budget` must be in (0, 1], got {float(budget):g}.\n"
    assert not out.exists()


def test_output_that_is_a_file_is_refused(tmp_path, capsys):
    path = tmp_path / "out"
    path.write_text("mine")
    assert main(["run", "-o", str(path)]) == 1
    assert "must be a folder" in capsys.readouterr().err
    assert path.read_text() == "mine"


def test_missing_data_says_how_to_get_it(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("CAMOJAB_DATA_DIR", str(tmp_path))
    out = tmp_path / "out"
    assert main(["run", "--data", "jindal2021", "-o", str(out)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "CAMOJAB_DATA_DIR" in error
    assert not out.exists()


# The command computes the fit in double precision whatever the lane.
@pytest.mark.float64
def test_authors_data(real_data, tmp_path):
    real_data(
        "jindal2021/Experiment_Data/vrs_exp_stimulus.mat",
        "jindal2021/Experiment_Data/vrs_exp_data_jnd.mat",
        "jindal2021/ALSaRR/sample_data/motion_n.exr",
        "jindal2021/ALSaRR/sample_data/all_polynomials.zip",
    )
    inputs = jindal2021_inputs(ppd=60.0, refresh_rate=60.0, frame_luminance=50.0)
    # One mip level: the other eleven take a minute and change nothing that is tested.
    inputs = dataclasses.replace(inputs, scene=Scene.every(len(inputs.textures), (0,)))
    outcome = run(inputs, tmp_path, budget=0.25)

    rows = fit_rows(inputs, outcome.fit)
    assert [row[1] for row in rows] == "0.740 0.570 0.534 0.384 0.036 0.533".split()
    assert [row[3].split()[0] for row in rows] == [
        *["rounds"] * 4,
        "truncates",
        "rounds",
    ]

    golden = np.load(GOLDEN)
    budget = golden["budget"][list(golden["budget_fraction"]).index(0.25)]
    with jax.enable_x64(True):
        best = greedy_jindal2021(golden["quality_jnd"], golden["cost"], budget)
        quality, rate = float(best.quality), np.asarray(best.rate)
    written = read_rates_bin(tmp_path / "rates.bin", rows=67, columns=120)
    np.testing.assert_array_equal(written.ravel(), rate)
    np.testing.assert_allclose(outcome.rate_map["quality_jnd"], quality, rtol=1e-12)


@pytest.mark.parametrize(
    "value, printed, verdict",
    [
        (0.7401, "0.74", "rounds to it"),
        (0.0359, "0.03", "truncates to it (rounds to 0.04)"),
        (0.30, "0.25", "differs by +0.050"),
    ],
)
def test_agreement(value, printed, verdict):
    assert agreement(value, printed) == verdict


def test_interrupted_stages_resume(tmp_path):
    done = []

    def work(name):
        done.append(name)
        (tmp_path / name).write_text(name)
        return {"name": name}

    def both(stop):
        stages = Stages(tmp_path)
        first, _ = stages.run("a", (1, np.ones(2)), ["a"], lambda: work("a"))
        if stop:
            raise KeyboardInterrupt
        second, _ = stages.run("b", (first,), ["b"], lambda: work("b"))
        return second

    with pytest.raises(KeyboardInterrupt):
        both(stop=True)
    assert both(stop=False) == {"name": "b"} and done == ["a", "b"]
    (tmp_path / "a").write_text("altered")
    both(stop=False)
    assert done == ["a", "b", "a"]
    (tmp_path / "run.json").write_text('{"a": {"inp')
    both(stop=False)
    assert done == ["a", "b", "a", "a", "b"]


def test_digest_sees_every_difference():
    import pandas

    table = pandas.DataFrame({"x": [1.0, 2.0]})
    parts = [
        (np.zeros(2),),
        (np.zeros(2, np.float32),),
        (np.zeros((2, 1)),),
        (np.array([0.0, 1e-300]),),
        ("0", "0"),
        ({"a": 1.0},),
        ({"b": 1.0},),
        (table,),
        (table + 1e-12,),
    ]
    keys = [digest(*part) for part in parts]
    assert len(set(keys)) == len(parts), keys
    assert digest(table, {"a": 1.0}) == digest(table.copy(), {"a": 1.0})

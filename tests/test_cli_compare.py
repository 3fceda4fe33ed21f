"""`camojab compare` and `camojab validate`, on own votes and on published data."""

import csv
import json
import re
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from camojab import comparison, datasets, fit, Formulation, Parameters, predict, votes
from camojab._compare_command import (
    _ablation,
    _by_parts,
    _constants,
    _drawn,
    _marrr,
)
from camojab._results import JINDAL2021 as COMPARED
from camojab._validate_command import _likelihood, FETCHED as VALIDATED
from camojab.cli import main


# The commands compute in double precision whatever the lane.
pytestmark = pytest.mark.float64

BASE = {
    "texture": "grey.npy",
    "mean_luminance_cd_m2": 100,
    "refresh_rate_hz": 60,
    "persistence": 1,
    "ppd": 60,
    "rate_y": 1,
    "mip_level": 1,
}
JND = {1: 0.0, 0.5: -0.8, 0.25: -2.0}
OWN = ["--votes", "votes.csv", "--conditions", "conditions.csv"]


def write(path, rows):
    with Path(path).open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def experiment(folder):
    """Two blocks of three shading rates each, and the votes of four observers."""
    generator = np.random.default_rng(3)
    np.save(folder / "grey.npy", generator.random((64, 64)))
    conditions, cast = [], []
    for block, velocity in (("slow", 5.0), ("fast", 20.0)):
        for rate in JND:
            name = {"block": block, "condition": f"rate {rate}", "rate_x": rate}
            conditions.append({**name, "velocity_deg_s": velocity, **BASE})
        for a, b in ((1, 0.5), (0.25, 1), (0.5, 0.25)) * 3:
            lead = (JND[a] - JND[b]) / votes._simulation.SIGMA
            cast += [
                {
                    "observer": f"o{k}",
                    "block": block,
                    "condition_a": f"rate {a}",
                    "condition_b": f"rate {b}",
                    "a_preferred": int(lead + generator.normal() > 0),
                }
                for k in range(4)
            ]
    write(folder / "conditions.csv", conditions)
    write(folder / "votes.csv", cast)


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """A folder with an experiment, and the two commands' folders in it."""
    folder = tmp_path_factory.mktemp("own")
    experiment(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["compare", *OWN, "-o", "compare"]) == 0
        assert main(["validate", *OWN, "-o", "validate"]) == 0
    return folder


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    experiment(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def observed(own):
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(own)
        comparisons = fit.read_comparisons("votes.csv", "conditions.csv")
    return comparisons, fit.scaled(comparisons)


def strict(path):
    def refuse(name):
        raise AssertionError(name)

    return json.loads(Path(path).read_text(), parse_constant=refuse)


def quality(own):
    """The model's, of every condition relative to the first of its block."""
    table = pd.read_csv(own / "conditions.csv")
    found = predict(table, folder=own)["quality_jnd"].to_numpy()
    return found - np.repeat(found[::3], 3)


# One's own votes


@pytest.mark.parametrize("command", ["compare", "validate"])
def test_files_and_no_others(own, command):
    names = sorted(path.name for path in (own / command).iterdir())
    assert names == sorted([f"{command}.json", f"{command}.csv", "report.html"])


@pytest.mark.parametrize("command", ["compare", "validate"])
def test_provenance(own, command):
    document = strict(own / command / f"{command}.json")
    assert document["schema"] == f"camojab-{command}/1"
    assert document["camojab"] == version("alsarr")
    assert document["data"] == "votes.csv"
    assert set(document["sha256"]) == {"votes.csv", "conditions.csv", "grey.npy"}
    assert document["parameters"]["beta"] == float(Parameters.published().beta)
    assert document["formulation"] == "released"


@pytest.mark.parametrize("command, pictures", [("compare", 1), ("validate", 1)])
def test_report_stands_alone(own, command, pictures):
    page = (own / command / "report.html").read_text()
    assert "http" not in page
    assert not re.search(r"(src|href)\s*=\s*['\"](?!data:)", page)
    assert page.count("data:image/png;base64,") == pictures
    assert "parameters: released, ws=-3.6985309" in page


def test_comparison_of_own_votes(own, observed):
    rows = strict(own / "compare" / "compare.json")["comparison"]
    table = pd.DataFrame(rows)
    assert len(table) == 3 * 2 * 4
    assert (table["reduction"] == "as given").all()
    fair = table[table["fair"]].set_index(["model", "block"])["rmse"]
    assert len(fair) == 6
    # What a slope of its own leaves of each block.
    measured = observed[1].table["quality_jnd"].to_numpy()
    for block, part in (("slow", slice(0, 3)), ("fast", slice(3, 6))):
        x, y = quality(own)[part], measured[part]
        left = np.sqrt(np.mean((y - x * (x @ y) / (x @ x)) ** 2))
        assert fair["CaMoJAB", block] == pytest.approx(left, rel=1e-9)


def test_every_model_gains_from_more_constants(own):
    table = pd.DataFrame(strict(own / "compare" / "compare.json")["comparison"])
    total = table.assign(square=table["rmse"] ** 2)
    total = total.groupby(["model", "sharing", "constants"])["square"].sum()
    for model in ("CaMoJAB", "MARRR", "NAS"):
        left = total[model]
        for sharing in ("shared", "per block"):
            both, one = (left[sharing, c] for c in ("slope and intercept", "slope"))
            assert both <= one + 1e-12
        assert left["per block", "slope"] <= left["shared", "slope"] + 1e-12


def test_csv_and_json_are_the_same_table(own):
    for name, key in (("compare", "comparison"), ("validate", "agreement")):
        rows = strict(own / name / f"{name}.json")[key]
        with (own / name / f"{name}.csv").open(newline="") as file:
            written = list(csv.DictReader(file))
        assert [list(row) for row in rows] == [list(row) for row in written]
        for row, text in zip(rows, written, strict=True):
            for column, value in row.items():
                cell = text[column]
                assert cell == ("" if value is None else str(value)), (name, column)


def test_ablation_of_own_votes(own):
    rows = pd.DataFrame(strict(own / "compare" / "compare.json")["ablation"])
    assert len(rows) == 9 * 3
    assert set(rows["block"]) == {"slow", "fast", "all"}
    whole = rows[rows["vrs"] & rows["eye_blur"] & rows["judder"]]
    blind = rows[~rows["vrs"] & rows["eye_blur"]]
    # Nothing else varies in a block, so that without shading nothing is seen.
    assert whole["rmse_jnd"].max() < blind["rmse_jnd"].min()


def test_agreement_with_own_votes(own, observed):
    comparisons, observations = observed
    rows = strict(own / "validate" / "validate.json")["agreement"]
    assert [row["block"] for row in rows] == ["slow", "fast", "all"]
    predicted, measured = quality(own), observations.table["quality_jnd"].to_numpy()
    cast = comparisons.votes
    sign = np.where(cast["a_preferred"], 1, -1)
    lead = sign * (predicted[cast["a"]] - predicted[cast["b"]])
    block = np.repeat(["slow", "fast"], 3)
    for row, name in zip(rows, ["slow", "fast", None], strict=True):
        here = (block == name) | (name is None)
        free = here & (np.arange(6) % 3 > 0)
        x, y = predicted[here], measured[here]
        factor = x @ y / (x @ x)
        heard = lead[here[cast["a"]]]
        likelihood = norm.logcdf(heard / votes._simulation.SIGMA).mean()
        expected = {
            "rows": here.sum(),
            "rmse_jnd": np.sqrt(np.mean((x - y) ** 2)),
            "slope": factor,
            "rmse_after_slope_jnd": np.sqrt(np.mean((factor * x - y) ** 2)),
            "pearson": np.corrcoef(predicted[free], measured[free])[0, 1],
            "votes": len(heard),
            "log_likelihood": likelihood,
            "log_likelihood_of_chance": np.log(0.5),
        }
        found = {name: row[name] for name in expected}
        assert found == pytest.approx(expected, rel=1e-8)
        assert row["log_likelihood_at_best_scale"] >= likelihood
        assert row["log_likelihood_of_scale"] > row["log_likelihood_of_chance"]
        assert -1 <= row["spearman"] <= 1


def test_the_scale_of_the_votes_is_that_of_the_library(own, observed):
    rows = strict(own / "validate" / "validate.json")["agreement"]
    cast = observed[0].votes
    found = votes.scale_groups(cast, by=["group"], prior=votes.Prior.BOUNDED).groups
    likelihood = rows[-1]["log_likelihood_of_scale"] * len(cast)
    assert likelihood == pytest.approx(found["log_likelihood"].sum(), rel=1e-9)


def test_the_most_likely_scale():
    generator = np.random.default_rng(1)
    lead = 0.7 * generator.normal(1, 2, 4000)
    won = generator.random(4000) < norm.cdf(lead / votes._simulation.SIGMA)
    cast = pd.DataFrame({"predicted": np.where(won, lead, -lead) / 0.7, "scaled": 0.0})
    found = _likelihood(cast)
    assert found["best_scale"] == pytest.approx(0.7, rel=0.06)
    assert found["log_likelihood_at_best_scale"] > found["log_likelihood"]
    chance = found["log_likelihood_of_chance"]
    assert found["log_likelihood_of_scale"] == pytest.approx(chance, rel=1e-12)
    assert _likelihood(cast.iloc[:0]) == {"votes": 0}


def test_constants_of_a_file_and_what_is_printed(here, own, capsys):
    values = {"ws": -1.5, "wt": -0.5, "beta": 0.3596635089963749}
    document = {"formulation": "released", "parameters": values}
    Path("p.json").write_text(json.dumps(document))
    command = ["validate", *OWN, "--parameters", "p.json", "-o", "out"]
    assert main(command) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Agreement with the votes"
    assert lines[2].startswith("block  rows  rmse [JND]  slope")
    found = strict("out/validate.json")
    for line, row in zip(lines[3:6], found["agreement"], strict=True):
        shown = [row["block"], str(row["rows"]), f"{row['rmse_jnd']:.3f}"]
        assert line.split()[:3] == shown
    assert "p.json" in found["sha256"]
    published = strict(own / "validate" / "validate.json")["agreement"]
    assert found["agreement"][0]["rmse_jnd"] != published[0]["rmse_jnd"]
    assert "ws=-1.5, wt=-0.5" in lines[-2]


def test_too_few_values_for_a_refit_are_told(observed):
    """Three values, of which one is the reference, and three constants."""
    few = fit.Observations(observed[1].table.iloc[:3], observed[1].textures)
    table, notes = _ablation(few, Formulation.RELEASED, lambda done, total: None)
    assert not len(table)
    assert notes == [
        "No refit without parts: `observations` must have more than 3 values, got 3."
    ]


# Published data


def test_validation_on_published_data(real_data, tmp_path, capsys):
    real_data(*VALIDATED)
    assert main(["validate", "-o", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    document = strict(tmp_path / "validate.json")
    rows = pd.DataFrame(document["agreement"])
    printed = rows[(rows["model"] == "CaMoJAB") & rows["printed"].notna()]
    assert list(printed["printed"]) == [0.42, 0.28, 0.69]
    # Table 5 of Jindal et al. 2021, to the digits it has.
    assert [f"{x:.2f}" for x in printed["rmse"]] == ["0.42", "0.28", "0.69"]
    assert len(document["scores"]) == 3 * (28 + 4 + 2 * 3)
    bars = pd.DataFrame(document["preferences"])
    expected = comparison.validation_preferences()
    pd.testing.assert_frame_equal(bars, expected, check_exact=True)
    assert len(document["preferences_by_scene"]) == 18
    page = (tmp_path / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 3 and "http" not in page
    assert set(VALIDATED) < set(document["sha256"])
    line = next(line for line in out.splitlines() if line.startswith("CaMoJAB  Mackin"))
    assert re.split(r"  +", line)[3:] == [
        *["28", "0.410", "3.818", "0.419", "score, 1 to 5", "0.915", "0.921", "0.42"]
    ]


def test_every_file_that_is_read_is_recorded(real_data, monkeypatch):
    real_data(*VALIDATED)
    asked, fetch = [], datasets.fetch

    def record(name):
        asked.append(name)
        return fetch(name)

    for module in (datasets._jindal2021, datasets._denes2020):
        monkeypatch.setattr(module, "fetch", record)
    comparison.measurements()
    assert set(COMPARED) == set(asked)
    comparison.validation_preferences()
    assert set(VALIDATED) == set(asked)


BLOCKS = ("Block-PC", "Block-Mobile", "Block-VR")


def table5():
    """Rows as `comparison.compare` has them, each with a number of its own."""
    rows = []
    for model in ("CaMoJAB", "MARRR"):
        coarse = "both axes" if model == "MARRR" else "along the motion"
        for reduction in ("along the motion", "both axes"):
            for velocity in ("tracked", "shown"):
                for sharing in ("shared", "per block"):
                    for constants in ("slope", "slope and intercept"):
                        paper = (reduction, velocity, sharing, constants) == (
                            *(coarse, "tracked", "shared", "slope"),
                        )
                        fair = (reduction, sharing, constants) == (
                            *("along the motion", "per block", "slope"),
                        )
                        rows += [
                            {
                                "model": model,
                                "block": block,
                                "reduction": reduction,
                                "velocity": velocity,
                                "sharing": sharing,
                                "constants": constants,
                                "rmse": 0.0,
                                "unit": "JND",
                                "printed": 1.0 if paper else np.nan,
                                "fair": fair,
                            }
                            for block in BLOCKS
                        ]
    return pd.DataFrame(rows).assign(rmse=lambda t: np.arange(len(t)) / 1000)


def numbers(table, **setting):
    for name, value in setting.items():
        table = table[table[name] == value]
    return [f"{x:.3f}" for x in table["rmse"]]


def test_what_is_said_of_marrr():
    table = table5()
    said = _marrr(table)
    one = {"model": "MARRR", "constants": "slope"}
    alone = {**one, "sharing": "per block", "reduction": "along the motion"}
    paper = {**one, "sharing": "shared", "reduction": "both axes"}
    paper = numbers(table, velocity="tracked", **paper)
    tracked = numbers(table, velocity="tracked", **alone)
    shown = numbers(table, velocity="shown", **alone)
    parts = [" / ".join(part) for part in (paper, tracked, shown)]
    assert all(len(part) == 3 for part in (paper, tracked, shown))
    assert [said.count(part) for part in parts] == [1, 1, 1]
    assert said.index(parts[0]) < said.index(parts[1]) < said.index(parts[2])
    assert "The latter is fair" in said


def test_constants_are_laid_out_by_block():
    table = table5()
    wide = _constants(table)
    assert list(wide) == ["model", "sharing", "constants", *BLOCKS]
    assert len(wide) == 8
    for _, row in wide.iterrows():
        own = table[(table["velocity"] == "tracked") & (table["model"] == row["model"])]
        own = own[own["reduction"] == "along the motion"]
        own = own[(own["sharing"] == row["sharing"])]
        own = own[own["constants"] == row["constants"]]
        assert list(row[list(BLOCKS)]) == list(own["rmse"])


def test_bars_are_of_the_paper_s_setting_and_the_fair_one():
    drawn = _drawn(table5())
    assert len(drawn) == 2 * 2 * 3
    paper = drawn["setting"] == "as in the paper"
    assert (drawn["velocity"] == "tracked").all()
    assert (
        drawn.loc[paper, "printed"].notna().all() and not drawn.loc[paper, "fair"].any()
    )
    assert drawn.loc[~paper, "fair"].all() and drawn.loc[~paper, "printed"].isna().all()


def test_parts_are_laid_out_by_block():
    rows = [
        {
            **dict(zip(("vrs", "eye_blur", "judder"), parts, strict=True)),
            "block": block,
            "rmse_jnd": i + j / 10,
            "beta": 0.1 * i,
            "temporal_share": 0.2 * i,
            "low_pass": "sinc" if i else "lorentzian",
            "verdict": "" if i else "ran out of steps",
        }
        for i, parts in enumerate([(True, True, True), (False, True, False)])
        for j, block in enumerate(["z", "a", "all"])
    ]
    wide = _by_parts(pd.DataFrame(rows))
    assert wide.to_dict("list") == {
        "parts": [
            "coarse shading + eye blur + judder",
            "eye blur, sinc for Lorentzian",
        ],
        "z": [0.0, 1.0],
        "a": [0.1, 1.1],
        "all": [0.2, 1.2],
        "beta": [0.0, 0.1],
        "temporal_share": [0.0, 0.2],
        "search": ["tolerance not met", "done"],
    }


# Data and command lines that are wrong


def failure(capsys, *argv, status=1):
    """The reason, in one line; what was there before is there still."""
    name = f"out/{argv[0]}.csv"
    Path("out").mkdir(exist_ok=True)
    Path(name).write_text("as it was")
    capsys.readouterr()
    assert main([*argv, "-o", "out"]) == status
    captured = capsys.readouterr()
    assert captured.out == "" and Path(name).read_text() == "as it was"
    assert len(list(Path("out").iterdir())) == 1
    (line,) = captured.err.splitlines()
    return line


BOTH = pytest.mark.parametrize("command", ["compare", "validate"])


@BOTH
@pytest.mark.parametrize(
    "options, message",
    [
        (["--votes", "votes.csv"], "Invalid value for '--votes': goes with"),
        (["--conditions", "conditions.csv"], "'--conditions': goes with"),
        (["--textures", "."], "'--textures': goes with --votes and --conditions."),
        (["--encoding", "sRGB"], "'--encoding': goes with --votes and --conditions."),
        ([*OWN, "--data", "jindal2021"], "'--data': does not go with --votes."),
        (["--data", "denes2020"], "'jindal2021'"),
    ],
)
def test_wrong_command_lines(here, capsys, command, options, message):
    line = failure(capsys, command, *options, status=2)
    assert message in line and line.endswith(f"See 'camojab {command} --help'.")


@BOTH
def test_files_that_are_not_there(here, capsys, command):
    absent = ["--votes", "absent.csv", "--conditions", "conditions.csv"]
    line = failure(capsys, command, *absent)
    assert line == "camojab: absent.csv: No such file or directory."
    line = failure(capsys, command, *OWN, "--parameters", "absent.json")
    assert line == "camojab: absent.json: No such file or directory."
    Path("grey.npy").unlink()
    line = failure(capsys, command, *OWN)
    assert "conditions.csv, line 2: `texture` must be a file, " in line


@BOTH
def test_published_data_that_are_not_there(here, capsys, monkeypatch, command):
    monkeypatch.setenv("CAMOJAB_DATA_DIR", str(here))
    assert "CAMOJAB_DATA_DIR" in failure(capsys, command)


@BOTH
def test_a_file_that_holds_no_parameters(here, capsys, command):
    Path("p.json").write_text("[]")
    line = failure(capsys, command, *OWN, "--parameters", "p.json")
    assert "p.json: not a parameter file" in line


@BOTH
def test_votes_on_what_is_not_described(here, capsys, command):
    text = Path("votes.csv").read_text().replace("rate 0.25", "rate 0.125", 1)
    Path("votes.csv").write_text(text)
    line = failure(capsys, command, *OWN)
    assert line.startswith("camojab: votes.csv, line ")
    assert "must be a condition of conditions.csv" in line


@BOTH
def test_textures_are_sought_in_their_folder(here, capsys, command):
    Path("far").mkdir()
    Path("grey.npy").rename("far/grey.npy")
    assert "`texture`" in failure(capsys, command, *OWN)
    np.save("far/grey.npy", np.ones((4, 4, 3)))
    # Found there, but in colour, of which the encoding must be named.
    line = failure(capsys, command, *OWN, "--textures", "far")
    assert "`--encoding` must be named for a colour texture" in line


@BOTH
def test_an_output_that_is_a_file_is_refused_before_the_work(here, capsys, command):
    Path("file").write_text("mine")
    argv = [command, "--votes", "absent.csv", "--conditions", "absent.csv"]
    assert main([*argv, "-o", "file"]) == 1
    assert "file: must be a folder to write into." in capsys.readouterr().err
    assert Path("file").read_text() == "mine"

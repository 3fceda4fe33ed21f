"""`camojab fit`, on the worked example of the README and on what cannot be used."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from camojab import fit, Formulation, load_parameters
from camojab._shipped import shipped
from camojab.cli import main


ROOT = Path(__file__).parents[1]
VOTES, CONDITIONS = shipped("example_votes.csv"), shipped("example_conditions.csv")
TRUTH = {"ws": -3.69853, "wt": -2.90682, "beta": 0.35966}

# The command computes in double precision whatever the lane.
pytestmark = pytest.mark.float64


def readme_commands():
    text = (ROOT / "README.md").read_text().replace("\\\n", " ")
    return [line for line in text.splitlines() if line.startswith("camojab ")]


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """The worked example, run as the README has it but for the folder's place."""
    folder = tmp_path_factory.mktemp("example")
    line = next(c for c in readme_commands() if c.startswith("camojab fit"))
    words = shlex.split(line)[1:]
    words = [str(ROOT / w) if w.startswith("data/") else w for w in words]
    words[words.index("fit/")] = str(folder / "fit")
    assert main(words) == 0
    return folder / "fit"


def test_the_example_prints_what_the_readme_says(example):
    stored = json.loads((example / "fit.json").read_text())
    text = (ROOT / "README.md").read_text()
    for name in TRUTH:
        printed = re.search(rf"^{name} +\w+ +(\S+) +(\S+) ", text, flags=re.MULTILINE)
        assert printed
        value, error = map(float, printed.groups())
        np.testing.assert_allclose(stored["values"][name], value, rtol=2e-4)
        np.testing.assert_allclose(stored["standard_error"][name], error, rtol=0.06)


def test_the_example_holds_the_truth(example):
    stored = json.loads((example / "fit.json").read_text())
    for name, value in TRUTH.items():
        away = abs(stored["values"][name] - value) / stored["standard_error"][name]
        assert away < 2
        low, high = (stored["bootstrap"][end][name] for end in ("low", "high"))
        assert low < value < high
    profile = stored["profiles"]["beta"]
    assert profile["low"] < TRUTH["beta"] < profile["high"]


def test_the_file_says_where_it_comes_from(example):
    stored = json.loads((example / "fit.json").read_text())
    wanted = (
        "parameters covariance standard_error correlation rmse_jnd log_likelihood aic "
        "bic result steps seed versions sha256 data free provenance formulation"
    )
    assert set(wanted.split()) <= set(stored)
    assert {Path(path).name for path in stored["sha256"]} == {
        "example_votes.csv",
        "example_conditions.csv",
    }
    assert stored["seed"] == 0 and "met its tolerance" in stored["result"]
    assert np.shape(stored["covariance"]) == (3, 3)
    found, formulation = load_parameters(example / "fit.json")
    assert formulation is Formulation.RELEASED
    np.testing.assert_allclose(found.beta, stored["values"]["beta"])


def test_predict_reads_the_fit(example, tmp_path, capsys):
    table = pd.read_csv(CONDITIONS).iloc[:2]
    table.to_csv(tmp_path / "some.csv", index=False)
    words = ["predict", str(tmp_path / "some.csv"), "-o", str(tmp_path / "out.csv")]
    assert main([*words, "--parameters", str(example / "fit.json")]) == 0
    assert "beta=0.350" in capsys.readouterr().out
    predicted = pd.read_csv(tmp_path / "out.csv")["quality_jnd"].to_numpy()
    rows = pd.read_csv(example / "fit.csv")["predicted_jnd"].to_numpy()
    np.testing.assert_allclose(predicted[1] - predicted[0], rows[1], rtol=1e-8)


def test_the_report_needs_no_network(example):
    page = (example / "report.html").read_text()
    assert not re.search(r"(src|href)=['\"]?https?:", page)
    assert page.count("data:image/png;base64,") == 4
    for heading in ("Constants", "Correlation", "Profile likelihood"):
        assert f"<h2>{heading}</h2>" in page
    rows = pd.read_csv(example / "fit.csv")
    assert len(rows) == 17 and rows["quality_jnd"].notna().all()
    inside = (rows["low_jnd"] <= rows["quality_jnd"]) & (
        rows["quality_jnd"] <= rows["high_jnd"]
    )
    assert inside.mean() > 0.9


def test_the_script_makes_the_example_again(tmp_path):
    shutil.copy(ROOT / "data" / "simulate_example.py", tmp_path)
    done = subprocess.run(
        [sys.executable, str(tmp_path / "simulate_example.py")], capture_output=True
    )
    assert done.returncode == 0, done.stderr
    for file in (VOTES, CONDITIONS):
        assert (tmp_path / file.name).read_bytes() == file.read_bytes()


def run(capsys, *words):
    status = main(["fit", *map(str, words)])
    return status, capsys.readouterr().err


OWN = ("--votes", VOTES, "--conditions", CONDITIONS)


@pytest.mark.parametrize(
    "words, status, message",
    [
        ((), 2, "--votes or --data"),
        (("--votes", VOTES), 2, "goes with --votes and --conditions"),
        ((*OWN, "--data", "simulated"), 2, "does not go with --votes"),
        ((*OWN, "--bootstrap", "1"), 2, "must be 0 or >= 2"),
        ((*OWN, "--free", "ws,gamma"), 1, "`--free` must be of ws, wt, beta"),
        ((*OWN, "--free", "ws,ws"), 1, "each constant once, got 'ws' twice"),
        ((*OWN, "--parameters", "none.json"), 1, "none.json: No such file"),
        ((*OWN, "--free", "ws,wt,scale:votes"), 1, "only 2 combinations"),
    ],
)
def test_what_cannot_be_done_is_said(tmp_path, capsys, words, status, message):
    folder = tmp_path / "fit"
    got, error = run(capsys, *words, "-o", folder)
    assert got == status and message in error
    assert error.count("\n") == 1
    assert not folder.exists()


def test_problems_of_the_files_name_their_lines(tmp_path, capsys):
    lines = VOTES.read_text().splitlines()
    lines[3] = "p00,5 deg/s,brick 1x1,brick 3x1,1"
    (tmp_path / "votes.csv").write_text("\n".join(lines))
    own = ("--votes", tmp_path / "votes.csv", "--conditions", CONDITIONS)
    status, error = run(capsys, *own, "-o", tmp_path / "fit")
    assert status == 1
    assert "votes.csv, line 4: `condition_b` must be a condition of" in error
    assert "got 'brick 3x1'" in error


def test_an_earlier_fit_is_kept_where_there_is_no_new_one(tmp_path, capsys):
    (tmp_path / "fit.json").write_text("earlier")
    status, _ = run(capsys, *OWN, "--free", "ws,gamma", "-o", tmp_path)
    assert status == 1
    assert [path.name for path in tmp_path.iterdir()] == ["fit.json"]
    assert (tmp_path / "fit.json").read_text() == "earlier"


def test_jnd_of_ones_own_votes(tmp_path, capsys):
    words = (*OWN, "--to", "jnd", "--free", "ws,wt,beta", "--bootstrap", 0)
    status, _ = run(capsys, *words, "--cross-validate", "texture", "-o", tmp_path)
    assert status == 0
    stored = json.loads((tmp_path / "fit.json").read_text())
    assert stored["data"]["kind"] == "JND" and stored["data"]["size"] == 12
    left = stored["cross_validation"]["texture"]
    assert [row["texture"] for row in left] == ["builtin:brick", "builtin:noise"]
    own = fit.read_comparisons(VOTES, CONDITIONS)
    jnd = fit.scaled(own).table["quality_jnd"]
    rows = pd.read_csv(tmp_path / "fit.csv")
    np.testing.assert_allclose(rows["quality_jnd"], jnd, atol=1e-12)
    rmse = np.sqrt(np.mean((rows["predicted_jnd"] - rows["quality_jnd"]) ** 2))
    np.testing.assert_allclose(stored["rmse_jnd"]["all"], rmse, rtol=1e-9)

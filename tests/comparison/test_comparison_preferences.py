"""Experiment 2's votes against chance."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import beta, binom

from camojab.comparison import validation_preferences


VALIDATION = "jindal2021/Experiment_Data/alsarr_validation_experiment.csv"
SCENES = ("scene", "budget", "against", "uniform_setting")


def votes(**wins_and_losses):
    rows = [
        {"against": name, "alsarr_preferred": preferred}
        for name, (wins, losses) in wins_and_losses.items()
        for preferred in [True] * wins + [False] * losses
    ]
    return pd.DataFrame(rows)


def test_figure_12a(real_data):
    real_data(VALIDATION)
    table = validation_preferences()
    keys = ["budget", "against", "uniform_setting"]
    assert [tuple(x) for x in table[keys].to_numpy()] == [
        (0.0625, "marrr", "1x1"),
        (0.0625, "uniform", "2x2"),
        (0.0625, "uniform", "4x4"),
        (0.125, "marrr", "1x1"),
        (0.125, "uniform", "2x2"),
        (0.125, "uniform", "4x2"),
    ]
    # Counted in the file itself with awk.
    assert table["preferred"].tolist() == [211, 183, 166, 146, 171, 168]
    assert table["votes"].tolist() == [216, 216, 217, 216, 216, 216]
    # "The difference is significant across all tested conditions" (section 5.6).
    assert (table["p_value"] < 1e-6).all() and (table["low"] > 0.6).all()


def test_figure_12b(real_data):
    real_data(VALIDATION)
    table = validation_preferences(by=SCENES)
    assert len(table) == 18 and table["votes"].sum() == 1297
    # The paper tests no single scene; in two cells of 18 chance would do.
    even = table[table["p_value"] > 0.05]
    assert even[list(SCENES)].to_numpy().tolist() == [
        ["scifi", 0.125, "marrr", "1x1"],
        ["scifi", 0.125, "uniform", "4x2"],
    ]
    whole = validation_preferences(by=())
    assert len(whole) == 1 and whole["votes"][0] == 1297
    assert whole["preferred"][0] == table["preferred"].sum()


def test_intervals_and_tests_by_definition():
    table = validation_preferences(votes(a=(14, 6), b=(9, 0), c=(5, 5)), by=["against"])
    wins, n = table["preferred"].to_numpy(), table["votes"].to_numpy()
    # Clopper and Pearson's ends as quantiles of beta distributions.
    low, high = beta.ppf(0.025, wins, n - wins + 1), beta.ppf(0.975, wins + 1, n - wins)
    np.testing.assert_allclose(table["low"], low)
    np.testing.assert_allclose(table["high"], np.where(wins == n, 1.0, high))
    # At even odds both tails weigh the same.
    tails = 2 * binom.sf(np.maximum(wins, n - wins) - 1, n, 0.5)
    np.testing.assert_allclose(table["p_value"], np.minimum(tails, 1))
    np.testing.assert_allclose(table["preference"], [0.7, 1.0, 0.5])


def test_more_confidence_is_a_wider_interval():
    some = votes(a=(14, 6))
    wide, narrow = (
        validation_preferences(some, by=["against"], confidence=c).iloc[0]
        for c in (0.99, 0.9)
    )
    assert wide["low"] < narrow["low"] < 0.7 < narrow["high"] < wide["high"]
    assert wide["p_value"] == narrow["p_value"]


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"by": ["game"]}, "`by` must name columns of against, .*, got 'game'"),
        ({"confidence": 1.0}, r"`confidence` must be in \(0, 1\), got 1"),
    ],
)
def test_wrong_input_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        validation_preferences(votes(a=(1, 1)), **{"by": ["against"], **arguments})


def test_no_votes_are_an_error():
    with pytest.raises(ValueError, match="`votes` must have one row or more, got 0"):
        validation_preferences(votes(a=(1, 1)).iloc[:0], by=["against"])

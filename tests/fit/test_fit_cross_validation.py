"""What was left out is predicted from the rest, by nothing else."""

import functools

import numpy as np
import pytest
from scipy.stats import norm

import invented
from camojab import fit
from invented import FREE, SCALES, SIGMA, TRUTH


pytestmark = pytest.mark.float64  # a fit is to be run in double precision


@functools.cache
def exact():
    return invented.fitted(invented.observations())


@functools.cache
def noisy():
    return invented.fitted(invented.observations(noise=0.2))


@functools.cache
def voted():
    return invented.fitted(invented.comparisons(observers=30))


def quality_of(row, **scales):
    constants = {name: row[name] for name in TRUTH}
    own = {name: row[f"scale:{name}"] for name in SCALES}
    return invented.quality(constants, own | scales)


@pytest.mark.parametrize("by", ["block", "velocity_deg_s", "data_set"])
def test_what_has_no_noise_is_predicted_exactly(by):
    """A data set that is left out whole, the first one too, has a scale of its own."""
    found = fit.cross_validate(exact(), by)
    values = list(dict.fromkeys(invented.table()[by]))
    assert found[by].tolist() == values and found["converged"].all()
    assert list(found) == [by, "size", "rmse_jnd", "rmse_seen_jnd", *FREE, "converged"]
    assert found["rmse_jnd"].max() < 1e-6 and found["rmse_seen_jnd"].max() < 1e-6
    assert found["size"].sum() == 22 - 4
    kept = found[found[by] != "rates"]
    for name, value in (TRUTH | {f"scale:{k}": v for k, v in SCALES.items()}).items():
        np.testing.assert_allclose(kept[name], value, rtol=1e-5)


def test_without_the_first_data_set_another_has_the_unit():
    found = fit.cross_validate(exact(), "data_set").set_index("data_set").loc["rates"]
    assert found["scale:refresh"] == 1
    for name in ("ws", "wt"):
        expected = TRUTH[name] * SCALES["refresh"]
        np.testing.assert_allclose(found[name], expected, rtol=1e-5)
    np.testing.assert_allclose(found["scale:judder"], SCALES["judder"], rtol=1e-5)


def test_errors_are_those_of_a_fit_without_the_block():
    given = noisy().data
    found = fit.cross_validate(noisy(), "block").set_index("block")
    rest = given.table["block"] != "B"
    table = given.table[rest].reset_index()
    # Rows have other numbers without those of the block.
    number = {old: new for new, old in enumerate(table["index"])}
    table = table.assign(reference=table["reference"].map(number))
    alone = invented.fitted(fit.Observations(table, given.textures))
    row = found.loc["B"]
    np.testing.assert_allclose(row[list(FREE)].astype(float), alone.values, rtol=1e-4)
    errors = quality_of(row) - given.table["quality_jnd"].to_numpy()
    relative = (given.table["reference"] != given.table.index).to_numpy()
    for chosen, column in ((~rest, "rmse_jnd"), (rest, "rmse_seen_jnd")):
        of = errors[chosen.to_numpy() & relative]
        np.testing.assert_allclose(row[column], np.sqrt(np.mean(of**2)), rtol=1e-9)
    assert row["size"] == 5
    # A block is foretold worse than it is fitted.
    assert found["rmse_jnd"].mean() > found["rmse_seen_jnd"].mean()


@pytest.mark.parametrize("by", ["block", "texture"])
def test_votes_are_left_out_with_either_condition(by):
    found = fit.cross_validate(voted(), by).set_index(by)
    votes = voted().data.votes
    column = invented.table()[by].to_numpy()
    a, b, won = (votes[n].to_numpy() for n in ("a", "b", "a_preferred"))
    assert list(found)[1:3] == ["log_likelihood", "log_likelihood_seen"]
    for value, row in found.iterrows():
        quality = quality_of(row)
        p = norm.cdf((quality[a] - quality[b]) / SIGMA)
        each = np.log(np.where(won, p, 1 - p))
        left = (column[a] == value) | (column[b] == value)
        assert row["size"] == left.sum()
        # The scale of a data set without votes left is not among the constants shown.
        if by == "texture" or value in ("A", "B"):
            np.testing.assert_allclose(row["log_likelihood"], each[left].mean())
        np.testing.assert_allclose(row["log_likelihood_seen"], each[~left].mean())
    assert (found["log_likelihood"] > np.log(0.5)).all()


def test_a_data_set_without_votes_left_has_the_scale_that_suits_it_best():
    found = fit.cross_validate(voted(), "data_set").set_index("data_set")
    votes = voted().data.votes
    own = (votes["group"] == "refresh").to_numpy()
    a, b, won = (votes[n].to_numpy()[own] for n in ("a", "b", "a_preferred"))
    row = found.loc["refresh"]

    def likelihood(scale):
        quality = quality_of(row, refresh=scale)
        p = norm.cdf((quality[a] - quality[b]) / SIGMA)
        return np.log(np.where(won, p, 1 - p)).mean()

    best = row["scale:refresh"]
    np.testing.assert_allclose(row["log_likelihood"], likelihood(best), rtol=1e-9)
    assert likelihood(best) > max(likelihood(best * 1.02), likelihood(best / 1.02))


def test_the_lapse_is_found_without_each_block():
    given = invented.comparisons(observers=400, data_sets=("rates",), lapse=0.05)
    free = ("ws", "wt", "beta", "lapse")
    found = fit.cross_validate(invented.fitted(given, free=free), "block")
    assert found["converged"].all()
    # Three standard errors of a block alone.
    np.testing.assert_allclose(found["lapse"], 0.05, atol=0.03)


@pytest.mark.parametrize(
    "by, message",
    [
        ("colour", r"`by` must be of texture, condition, .*, got 'colour'\."),
        ("one", r"`by` must have two values or more, got 'one' with one\."),
        (
            "most",
            r"`by` must leave data out, and more than 5 in, got 'most', which "
            r"leaves \d+ out and 4 in for 1\.",
        ),
    ],
)
def test_wrong_columns(by, message):
    given = invented.observations()
    table = given.table.assign(
        one=1, most=(given.table["data_set"] != "refresh").astype(int)
    )
    found = invented.fitted(fit.Observations(table, given.textures))
    with pytest.raises(ValueError, match=message):
        fit.cross_validate(found, by)

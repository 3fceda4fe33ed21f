"""Fits to experiments of which everything is known: constants, errors and criteria."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import binom, norm

import invented
from camojab import fit
from camojab.fit import Solver
from camojab.fit._fit import _observed_information, search, solve
from invented import FREE, SCALES, SIGMA, TRUE_VALUES, TRUTH


pytestmark = pytest.mark.float64  # a fit is to be run in double precision

SOLVERS = list(Solver)


def natural_to_search(values):
    """Logarithms, of which those of the lapse are of its odds."""
    values = np.abs(np.asarray(values, float))
    return np.log(values)


def quality_at(point):
    """Of the rows at a point of the search, without anything of the fit's."""
    values = np.exp(point)
    constants = dict(zip(TRUTH, values * [-1, -1, 1, 1, 1], strict=False))
    return invented.quality(constants, dict(zip(SCALES, values[3:], strict=True)))


def numerical_hessian(f, x, h):
    """Central differences of a function of a vector."""
    step = np.eye(len(x)) * h
    corners = lambda a, b: f(x + a + b) - f(x + a - b) - f(x - a + b) + f(x - a - b)
    return np.array([[corners(a, b) for b in step] for a in step]) / (4 * h**2)


# ---- JND


@functools.cache
def noisy():
    given = invented.observations(noise=0.2)
    return given, invented.fitted(given)


def test_exact_jnd_give_the_constants_back():
    found = invented.fitted(invented.observations())
    assert found.converged and found.solver is Solver.LEVENBERG_MARQUARDT
    assert found.verdict == f"met its tolerance after {found.steps} steps"
    assert found.free == FREE
    np.testing.assert_allclose(found.values, TRUE_VALUES, rtol=1e-7)
    assert found.total_rmse < 1e-7 and found.lapse == 0
    assert found.scales == pytest.approx(SCALES, rel=1e-7)
    np.testing.assert_allclose(found.predicted, invented.quality(), atol=1e-7)


def test_errors_of_a_fit_to_jnd_are_those_of_scipy():
    given, found = noisy()
    rows = invented.table()
    counted = (rows["reference"] != rows.index).to_numpy()
    measured = given.table["quality_jnd"].to_numpy()
    residuals = lambda point: (quality_at(point) - measured)[counted]
    start = natural_to_search(found.values)
    theirs = least_squares(residuals, start, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    np.testing.assert_allclose(np.exp(theirs.x), np.abs(found.values), rtol=1e-5)
    freedom = counted.sum() - len(FREE)
    variance = 2 * theirs.cost / freedom
    spread = variance * np.linalg.inv(theirs.jac.T @ theirs.jac)
    natural = spread * np.outer(found.values, found.values)
    np.testing.assert_allclose(found.covariance, natural, rtol=1e-4)
    np.testing.assert_allclose(found.standard_error, np.sqrt(np.diag(natural)), 1e-4)


def test_criteria_of_a_fit_to_jnd():
    given, found = noisy()
    errors = found.predicted - given.table["quality_jnd"].to_numpy()
    relative = given.table["reference"] != given.table.index
    of = errors[relative]
    assert len(of) == 22 - 4
    likelihood = norm.logpdf(of, scale=np.sqrt(np.mean(of**2))).sum()
    np.testing.assert_allclose(found.log_likelihood, likelihood, rtol=1e-9)
    # Five constants and the standard deviation.
    np.testing.assert_allclose(found.aic, 2 * 6 - 2 * likelihood, rtol=1e-9)
    np.testing.assert_allclose(found.bic, 6 * np.log(18) - 2 * likelihood, rtol=1e-9)
    np.testing.assert_allclose(found.total_rmse, np.sqrt(np.mean(errors**2)))
    for block, rmse in found.rmse.items():
        mine = errors[given.table["block"] == block]
        np.testing.assert_allclose(rmse, np.sqrt(np.mean(mine**2)))


def test_correlation_and_report():
    _, found = noisy()
    np.testing.assert_allclose(np.diag(found.correlation), 1.0)
    assert (np.abs(found.correlation) <= 1 + 1e-12).all()
    back = found.correlation * np.outer(found.standard_error, found.standard_error)
    np.testing.assert_allclose(back, found.covariance)
    line = found.report()
    assert "\n" not in line and line.startswith("released, ws=-")
    assert f"beta={found.values[2]:.6g}±{found.standard_error[2]:.2g}" in line


# ---- votes

LAPSES = {FREE: 0.0, (*FREE, "lapse"): 0.05}


@functools.cache
def many_votes(free=FREE, each=1e4):
    target = invented.expected_votes(each, LAPSES[free])
    return invented.fitted(invented.comparisons(), free=free, target=target)


@pytest.mark.parametrize("free", LAPSES)
def test_expected_votes_give_the_constants_back(free):
    found = many_votes(free)
    assert found.converged and found.solver is Solver.SCORING
    truth = (*TRUE_VALUES, LAPSES[free])
    np.testing.assert_allclose(found.values, truth[: len(free)], rtol=1e-5)
    np.testing.assert_allclose(found.lapse, LAPSES[free], rtol=1e-5)


@pytest.mark.parametrize("lapse", [0.0005, 0.005, 0.02, 0.2])
def test_lapse_is_found_from_its_one_start(lapse):
    """A long first step must not take it to 0, where nothing would bring it back."""
    target = invented.expected_votes(1e4, lapse)
    free = (*FREE, "lapse")
    found = invented.fitted(invented.comparisons(), free=free, target=target)
    assert found.converged
    np.testing.assert_allclose(found.values, (*TRUE_VALUES, lapse), rtol=1e-4)


@pytest.mark.parametrize("free", LAPSES)
def test_errors_of_a_fit_to_votes_are_those_of_the_likelihood(free):
    """The curvature of SciPy's binomial likelihood where the votes are as expected."""
    found, each = many_votes(free), 1e4
    wins = each * invented.preference(LAPSES[free])

    def likelihood(point):
        lapse = 1 / (1 + np.exp(-point[5])) if len(point) > 5 else 0.0
        p = invented.preference(lapse, quality_at(point[:5]))
        return np.sum(wins * np.log(p) + (each - wins) * np.log1p(-p))

    values = np.array([*TRUE_VALUES, LAPSES[free]][: len(free)])
    point, slope = natural_to_search(values), values.copy()
    if len(free) > 5:
        point[5] = np.log(values[5] / (1 - values[5]))
        slope[5] = values[5] * (1 - values[5])
    hessian = numerical_hessian(likelihood, point, 1e-4)
    expected = -np.linalg.inv(hessian) * np.outer(slope, slope)
    np.testing.assert_allclose(found.standard_error, np.sqrt(np.diag(expected)), 1e-3)
    error = np.sqrt(np.diag(expected))
    correlation = expected / np.outer(error, error)
    np.testing.assert_allclose(found.correlation, correlation, atol=1e-3)


def test_criteria_of_a_fit_to_votes():
    given = invented.comparisons(observers=12)
    found = invented.fitted(given)
    a, b, won = (given.votes[n].to_numpy() for n in ("a", "b", "a_preferred"))
    p = norm.cdf((found.predicted[a] - found.predicted[b]) / SIGMA)
    likelihood = np.sum(np.log(np.where(won, p, 1 - p)))
    np.testing.assert_allclose(found.log_likelihood, likelihood, rtol=1e-10)
    assert len(won) == 12 * (15 + 15 + 10 + 10)
    np.testing.assert_allclose(found.aic, 2 * 5 - 2 * likelihood, rtol=1e-10)
    expected = 5 * np.log(len(won)) - 2 * likelihood
    np.testing.assert_allclose(found.bic, expected, rtol=1e-10)
    # Of the JND that the votes scale to.
    scaled = fit.scaled(given).table
    errors = found.predicted - scaled["quality_jnd"].to_numpy()
    np.testing.assert_allclose(found.total_rmse, np.sqrt(np.mean(errors**2)))
    assert list(found.rmse) == ["A", "B", "refresh", "judder"]
    mine = errors[scaled["block"] == "refresh"]
    np.testing.assert_allclose(found.rmse["refresh"], np.sqrt(np.mean(mine**2)))


# ---- solvers


# Each compiles for seconds, for votes even more.
BOTH = [
    *((solver, "JND") for solver in SOLVERS),
    (Solver.LEVENBERG_MARQUARDT, "votes"),
    (Solver.BFGS, "votes"),
]


@pytest.mark.parametrize("solver, kind", BOTH)
def test_solvers_agree(solver, kind):
    if kind == "JND":
        given, expected = noisy()
    else:
        given = invented.comparisons(observers=12)
        expected = invented.fitted(given)
    found = invented.fitted(given, solver=solver, max_steps=256)
    assert found.converged, found.verdict
    assert found.solver is solver
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-6)
    np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=1e-9)


@pytest.mark.parametrize(
    "solver", [Solver.LEVENBERG_MARQUARDT, Solver.SCORING, Solver.JAXOPT_LBFGSB]
)
def test_steps_that_run_out_are_said(solver):
    found = invented.fitted(noisy()[0], solver=solver, max_steps=2)
    assert not found.converged and found.steps == 2
    assert found.verdict == "stopped after 2 steps without meeting its tolerance"
    assert np.isfinite(found.total_rmse)


# ---- what cannot be known


@pytest.mark.parametrize(
    "kind, free, named, known",
    [
        (
            "JND",
            ("ws", "wt", "beta", "scale:rates", "scale:refresh"),
            "ws, wt, scale:rates, scale:refresh",
            3,
        ),
        (
            "votes",
            ("ws", "wt", "scale:rates", "scales"),
            "ws, wt, scale:rates, scale:refresh",
            3,
        ),
    ],
)
def test_redundant_constants_are_named(kind, free, named, known):
    """One factor on all the qualities of the rates and of the refresh rates."""
    given = invented.observations() if kind == "JND" else invented.comparisons()
    message = rf"these data tell apart, got {named}, of which only {known} combin"
    with pytest.raises(ValueError, match=rf"{message}.*: hold 1 of them\.$"):
        invented.fitted(given, free=free)


def test_two_redundancies_are_two():
    """Without judder there are two blocks, and a data set has two factors on it."""
    rows = invented.table()
    kept = rows["data_set"] == "refresh"
    part = rows[kept].reset_index(drop=True).assign(reference=0)
    given = fit.Observations(
        part.assign(quality_jnd=invented.quality()[kept]), invented.textures()
    )
    free = ("ws", "wt", "scale:refresh")
    with pytest.raises(ValueError, match="got ws, wt, scale:refresh, of which only 2"):
        invented.fitted(given, free=free)


@pytest.mark.parametrize(
    "kind, free, message",
    [
        ("JND", (*FREE, "lapse"), "an effect on these data, got lapse: hold it"),
        ("votes", (*FREE, "lapse"), "these data bound, got lapse, .*: hold it"),
        (
            "JND without refresh",
            ("beta", "scales"),
            "an effect on these data, got scale:refresh: hold it",
        ),
        (
            "judder alone",
            ("beta", "ws", "wt"),
            "an effect on these data, got ws, wt: hold them",
        ),
    ],
)
def test_constants_without_effect_are_named(kind, free, message):
    given = invented.observations()
    target = None
    if kind == "votes":
        given, target = invented.comparisons(), invented.expected_votes(1e4)
    elif kind == "JND without refresh":
        # Full rate everywhere: measured as 0 on both sides.
        table = given.table
        own = table["data_set"] == "refresh"
        table.loc[own, "reference"] = table.index[own]
    elif kind == "judder alone":
        part = given.table[given.table["data_set"] == "judder"]
        part = part.reset_index(drop=True).assign(reference=0)
        given = fit.Observations(part, given.textures)
    with pytest.raises(ValueError, match=message + r"\.$"):
        invented.fitted(given, free=free, target=target)


@pytest.mark.parametrize("size", [3, 4])
def test_as_many_data_as_constants_are_too_few(size):
    table = invented.observations().table.iloc[:size]
    given = fit.Observations(table, invented.textures())
    message = rf"`data` must have more values than the 3 constants .*, got {size - 1}\."
    with pytest.raises(ValueError, match=message):
        invented.fitted(given, free=("ws", "wt", "beta"))


# ---- do the errors hold what they promise

REPETITIONS = 200
VOTES = 60
# 95 % of 200: with this many the binomial distribution has 1.3e-4 on either side.
FEWEST = int(binom.ppf(1.3e-4, REPETITIONS, 0.95))


@functools.cache
def repeated():
    """The same experiment 200 times over: 60 votes on each of 50 pairs."""
    posed = many_votes().problem
    share = invented.preference()
    draw = np.random.default_rng(7)
    wins = jnp.asarray(draw.binomial(VOTES, share, (REPETITIONS, len(share))), float)

    @jax.jit
    @jax.vmap
    def experiment(wins):
        where = lambda p: (p.target.wins, p.target.votes)
        own = eqx.tree_at(where, posed, (wins, jnp.full_like(wins, VOTES)))
        found = solve(own, own.constants.point(), Solver.SCORING)
        information = _observed_information(own, found.point)
        return found.point, found.converged, jnp.linalg.inv(information)

    return [np.asarray(x) for x in experiment(wins)]


def test_every_repetition_converges():
    assert repeated()[1].all()


@pytest.mark.parametrize("index, name", [*enumerate(FREE)])
def test_standard_errors_cover(index, name):
    """In the logarithm, which is what the fit's errors are computed in."""
    points, _, covariance = repeated()
    truth = np.log(np.abs(TRUE_VALUES[index]))
    spread = covariance[:, index, index]
    off = np.abs(points[:, index] - truth) / np.sqrt(spread)
    covered = int(np.sum(off < norm.ppf(0.975)))
    assert FEWEST == 177
    assert FEWEST <= covered < REPETITIONS, name
    # And are no wider than they need be: chi-square of 200, four deviations.
    assert 0.8 < np.sqrt(np.mean(off**2)) < 1.2


def test_search_with_all_constants_held_but_the_lapse():
    target = invented.expected_votes(1e4, 0.05)
    posed = many_votes().problem
    chosen = posed.constants.at(jnp.asarray(many_votes().point)).freed(["lapse"])
    chosen = eqx.tree_at(lambda c: c.lapse, chosen, jnp.asarray(0.02))
    own = eqx.tree_at(lambda p: (p.target, p.constants), posed, (target, chosen))
    found = search(own, Solver.SCORING)
    assert found.converged
    np.testing.assert_allclose(own.constants.at(found.point).lapse, 0.05, rtol=1e-5)

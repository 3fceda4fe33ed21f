"""How long the fits take, compilation apart, and beside SciPy on the same residuals.

    python tests/benchmarks/bench_fit.py

needs the public data of Jindal et al. 2021 and prints a line for each figure. The
machine should have nothing else to do.
"""

import resource
import statistics
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from camojab import fit, votes
from camojab.fit._fit import search, solve


FIVE = ("ws", "wt", "beta", "scales")
MANY = (*FIVE, "ca", "mipmap_width", "hold_width", "lapse")


def main():
    with jax.enable_x64(True):
        pooled, jnd = timed(lambda: fit.fit(fit.jindal2021()))
        say("pooling spectra and compiling, once", pooled)
        refit = refit_of(jnd)
        beside_scipy(jnd, refit)
        cast = fit.jindal2021_comparisons()
        likelihood_of_all(cast)
        bootstraps(jnd, cast)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak memory: {peak:.0f} MiB")


def refit_of(jnd):
    start = jnd.problem.constants.point()
    compiling, _ = timed(lambda: solve(jnd.problem, start))
    seconds = median(lambda: solve(jnd.problem, start))
    say(f"refit of {len(jnd.free)} constants to JND", seconds, compiling)
    return seconds


def beside_scipy(jnd, refit):
    residuals = eqx.filter_jit(lambda x: jnd.problem.residuals(x))
    slope = eqx.filter_jit(lambda x: jax.jacfwd(jnd.problem.residuals)(x))
    start = np.asarray(jnd.problem.constants.point())
    call = lambda: least_squares(
        lambda x: np.asarray(residuals(jnp.asarray(x))),
        start,
        lambda x: np.asarray(slope(jnp.asarray(x))),
        method="lm",
        xtol=1.5e-8,
        ftol=1.5e-8,
    )
    compiling, found = timed(call)
    own = 0.5 * float(jnp.sum(residuals(jnp.asarray(jnd.point)) ** 2))
    np.testing.assert_allclose(found.cost, own, rtol=1e-9)
    seconds = median(call)
    say("the same by scipy.optimize.least_squares", seconds, compiling)
    print(f"ratio to SciPy: {refit / seconds:.2f}")


def likelihood_of_all(cast):
    five = fit.fit(cast, free=FIVE)
    start = five.problem.constants.point()
    seconds = median(lambda: solve(five.problem, start, five.solver))
    say(f"likelihood of the votes, {len(five.free)} constants", seconds)
    many = fit.fit(cast, free=MANY)
    seconds, found = timed(lambda: search(many.problem, many.solver))
    name = f"likelihood of the votes, {len(many.free)} constants"
    say(f"{name}, {int(found.steps)} steps", seconds)
    bootstrap("votes", five, None)


def bootstraps(jnd, cast):
    bootstrap("JND", jnd, cast)
    table = votes.votes_jindal2021()
    options = {"by": ("block", "velocity_deg_s"), "prior": votes.Prior.BOUNDED}
    call = lambda seed: votes.bootstrap(table, key=jax.random.key(seed), **options)
    compiling, _ = timed(lambda: call(0))
    seconds, found = timed(lambda: call(1))
    assert found.samples.shape[0] == 1000
    say("1000 scalings of nine groups", seconds, compiling)


def bootstrap(name, found, cast):
    call = lambda seed: fit.bootstrap(found, key=jax.random.key(seed), votes=cast)
    compiling, _ = timed(lambda: call(0))
    seconds, _ = timed(lambda: call(1))
    say(f"1000 refits of {len(found.free)} constants to {name}", seconds, compiling)


def timed(call):
    start = time.perf_counter()
    found = jax.block_until_ready(call())
    return time.perf_counter() - start, found


def median(call, runs=9):
    return statistics.median(timed(call)[0] for _ in range(runs))


def say(name, seconds, compiling=None):
    more = "" if compiling is None else f" (first call {compiling:.1f} s)"
    print(f"{name}: {seconds:.4g} s{more}", flush=True)


if __name__ == "__main__":
    main()

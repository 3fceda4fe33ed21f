"""Polynomials that keep an order: least squares as quadratic programmes.

Two ways to solve them, each where it is the faster. Polynomials of many coefficients
touch their bounds in hundreds of places: there a splitting method, whose linear system
is diagonal once and for all tables. The two factors of a product have a few dozen and
touch in a dozen: there the active set, with the places found on the way.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ._orthonormal import orthonormal


Order = tuple[tuple[int, int], ...]

_EXACT = jax.lax.Precision.HIGHEST

# What the splitting may leave of a bound, and of the slope in each coefficient. [JND].
_SMALL = 3e-4
# Steps after which the weight is set anew and the end is looked for, and all of them.
_STEPS, _MOST_STEPS = 25, 8000
# How far a step goes beyond its own solution, and the weight that bounds begin with.
_RELAXED, _FIRST_WEIGHT = 1.6, 10.0

# Rounds of alternation, what may be left of the sum of squares, and places tried.
_MOST_ROUNDS, _LITTLE, _MOST_SETS = 30, 1e-5, 200
# Smallest value of the second factor to start from and to raise a rate by; its largest
# is 1.
_LOWEST, _USABLE = 0.05, 1e-3


class _Order(NamedTuple):
    """Pairs as rows of +1 and -1, and the rates after all that they are bound by."""

    differences: Float[np.ndarray, "pairs rates"]
    rising: tuple[tuple[int, tuple[int, ...]], ...]

    @classmethod
    def of(cls, pairs: Order, rates: int) -> "_Order":
        if not pairs or not all(0 <= f < rates and -1 <= c < rates for f, c in pairs):
            raise ValueError(
                f"`order` must have pairs of rates from 0 to {rates - 1}, the second "
                f"also -1, got {pairs}."
            )
        below = {k: {c for f, c in pairs if f == k} for k in range(rates)}
        rising: list[tuple[int, tuple[int, ...]]] = []
        while len(rising) < rates:
            known = {-1, *(k for k, _ in rising)}
            ready = [k for k in below if k not in known and below[k] <= known]
            if not ready:
                raise ValueError(f"`order` must not go round in a circle, got {pairs}.")
            rising += [(k, tuple(sorted(below[k]))) for k in ready]
        every = np.eye(rates + 1)[:, :rates]
        better, worse = zip(*pairs, strict=True)
        return cls(every[list(better)] - every[list(worse)], tuple(rising))


@eqx.filter_jit
def fit_constrained_linear(
    design: Float[Array, "n p"],
    target: Float[Array, "*tables rates n"],
    grid: Float[Array, "m p"],
    order: Order,
    margin: float,
) -> Float[Array, "*tables rates p"]:
    """Least squares of linear functions that keep an order on a grid.

    Minimises `sum((design @ c[k] - target[k])**2)` over all rates `k` together subject
    to `grid @ (c[better] - c[worse]) >= margin` for every pair in `order`. What does
    not depend on the target is computed once for all tables of a call.

    **Arguments:**

    - `design`: the functions at the samples, of about one size. Where the samples do
      not determine every coefficient, the smallest ones are taken.
    - `target`: what to reproduce at the samples. [JND], finite.
    - `grid`: the same functions where the order must hold. A constant must be among
      their combinations. It is the faster the closer its points are to the samples.
    - `order`: (better, worse) rate, -1 for a rate that is 0. Static.
    - `margin`: [JND], >= 0. Static.

    **Returns:** coefficients that keep the order at every point of the grid. What the
    iterations leave below `margin` is made good by raising rates by constants.

    **Raises:** `ValueError` if `order` has no pairs, other rates or a circle.

    **Accuracy:** the root of the mean square comes within 3e-4 JND of the smallest;
    a target that keeps the order comes back as without constraints.

    **Source:** Stellato et al. 2020, Math. Prog. Comp. 12, 637-672, Algorithm 1, with
    the system solved in the common eigenvectors of its factors.
    """
    *tables, rates, n = target.shape
    ordered = _Order.of(order, rates)
    basis = orthonormal(design)
    to_design = basis.to_monomials * n**0.5
    everywhere = jnp.matmul(grid, to_design, precision=_EXACT)
    _, size, turn = jnp.linalg.svd(_tall(everywhere), full_matrices=False)
    turned = jnp.matmul(everywhere, turn.T, precision=_EXACT)
    one = _constant(grid)

    def fit(of_table: Float[Array, "rates n"]) -> Float[Array, "rates p"]:
        free = jnp.matmul(of_table, basis.values, precision=_EXACT) / n**0.5
        free = jnp.matmul(free, turn.T, precision=_EXACT)
        found = _split(free, turned, size**2, ordered.differences, margin)
        found = jnp.matmul(found, turn, precision=_EXACT)
        found = jnp.matmul(found, to_design.T, precision=_EXACT)
        return _raised(found, grid, one, ordered, margin)

    # Side by side they would wait for the slowest, and leave the cache.
    found = jax.lax.map(fit, target.reshape(-1, rates, n))
    return found.reshape(*tables, rates, -1)


class _Split(NamedTuple):
    """Coefficients, the differences they make, and how hard the bounds pull."""

    x: Float[Array, "rates p"]
    z: Float[Array, "pairs m"]
    y: Float[Array, "pairs m"]
    weight: Float[Array, ""]
    steps: Int[Array, ""]
    done: Bool[Array, ""]


def _split(
    free: Float[Array, "rates p"],
    grid: Float[Array, "m p"],
    square: Float[Array, " p"],
    differences: Float[np.ndarray, "pairs rates"],
    margin: float,
) -> Float[Array, "rates p"]:
    """The point nearest to `free` that keeps the order.

    The columns of `grid` are orthogonal, with `square` for their squared lengths.
    """
    dtype = free.dtype
    difference = jnp.asarray(differences, dtype)
    eigenvalue, vector = np.linalg.eigh(differences.T @ differences)
    pull = jnp.asarray(np.maximum(eigenvalue, 0), dtype)[:, None] * square[None, :]
    turn = jnp.asarray(vector, dtype)
    size = jnp.maximum(jnp.max(jnp.abs(free)), margin)
    small = jnp.maximum(_SMALL, 50 * jnp.finfo(dtype).eps * size)

    def onto(x: Array) -> Array:
        return difference @ jnp.matmul(x, grid.T, precision=_EXACT)

    def back(y: Array) -> Array:
        return jnp.matmul(difference.T @ y, grid, precision=_EXACT)

    def step(_: Array, s: _Split) -> _Split:
        right = turn.T @ (free + back(s.weight * s.z - s.y))
        x = turn @ (right / (1 + s.weight * pull))
        mixed = _RELAXED * onto(x) + (1 - _RELAXED) * s.z
        z = jnp.maximum(mixed + s.y / s.weight, margin)
        return s._replace(x=x, z=z, y=s.y + s.weight * (mixed - z))

    def steps(s: _Split) -> _Split:
        s = jax.lax.fori_loop(0, _STEPS, step, s)
        pulled = back(s.y)
        apart = jnp.max(jnp.abs(onto(s.x) - s.z))
        slope = jnp.max(jnp.abs(s.x - free + pulled))
        apart_share = apart / jnp.maximum(jnp.max(jnp.abs(s.z)), small)
        slope_share = slope / jnp.maximum(jnp.max(jnp.abs(pulled)), small)
        tiny = jnp.finfo(dtype).tiny
        ratio = jnp.sqrt((apart_share + tiny) / (slope_share + tiny))
        # A new weight upsets what has been reached.
        far = (ratio > 5) | (ratio < 0.2)
        weight = jnp.where(far, s.weight * jnp.clip(ratio, 0.01, 100), s.weight)
        done = (apart <= small) & (slope <= small)
        return s._replace(weight=weight, steps=s.steps + _STEPS, done=done)

    at = onto(free)
    start = _Split(
        x=free,
        z=jnp.maximum(at, margin),
        y=jnp.zeros_like(at),
        weight=_FIRST_WEIGHT / jnp.maximum(jnp.mean(square), 1e-6),
        steps=jnp.zeros((), int),
        done=jnp.all(at >= margin),
    )
    going = lambda s: ~s.done & (s.steps < _MOST_STEPS)
    return jax.lax.while_loop(going, steps, start).x


def _tall(matrix: Float[Array, "m p"]) -> Float[Array, "rows p"]:
    """No fewer rows than columns, or not every column would have its direction."""
    rows, columns = matrix.shape
    return jnp.pad(matrix, ((0, max(0, columns - rows)), (0, 0)))


def _constant(grid: Float[Array, "m p"]) -> Float[Array, " p"]:
    """The coefficients of 1, the smallest if there are others."""
    basis = orthonormal(grid)
    shares = jnp.sum(basis.values, axis=0)
    return jnp.matmul(basis.to_monomials, shares, precision=_EXACT)


def _raised(
    c: Float[Array, "rates p"],
    grid: Float[Array, "m p"],
    one: Float[Array, " p"],
    order: _Order,
    margin: float,
) -> Float[Array, "rates p"]:
    """Every rate raised by the constant that it lacks, the worse ones first."""
    found: dict[int, Array] = {}
    value = {-1: jnp.zeros(grid.shape[0], c.dtype)}
    for k, worse in order.rising:
        at = jnp.matmul(grid, c[k], precision=_EXACT)
        lacks = [jnp.max(value[w] + margin - at) for w in worse]
        raise_by = jnp.maximum(jnp.max(jnp.stack(lacks)), 0) if lacks else 0.0
        found[k] = c[k] + raise_by * one
        value[k] = jnp.matmul(grid, found[k], precision=_EXACT)
    return jnp.stack([found[k] for k in range(c.shape[0])])


@eqx.filter_jit
def fit_constrained_product(
    motion: Float[Array, "n d"],
    light: Float[Array, "n e"],
    target: Float[Array, "*tables rates n"],
    grid_motion: Float[Array, "m d"],
    grid_light: Float[Array, "m e"],
    order: Order,
    margin: float,
) -> tuple[Float[Array, "*tables rates d"], Float[Array, "*tables rates e"]]:
    """Least squares of products of two linear functions that keep an order on a grid.

    Minimises `sum(((motion @ a[k]) * (light @ b[k]) - target[k])**2)` over all rates
    `k` together subject to the product of `better` being no less than that of `worse`
    plus `margin`, at every point of the grid, for every pair in `order`. The factors
    are solved for in turn, a quadratic programme each, from the nearest product that
    keeps no order: a local optimum.

    **Arguments:** as `fit_constrained_linear`, with columns that are orthonormal (or 0)
    over the samples, and a constant among the combinations of each factor's.

    **Returns:** both factors' coefficients; the largest of the second factor's
    magnitudes over the grid is 1. They keep the order at every point of the grid.

    **Raises:** as `fit_constrained_linear`.

    **Accuracy:** the sum of squares comes within 2e-3 of that of both factors together
    (SciPy's SLSQP from there) on the model's qualities. Where rates are bound by each
    other and nothing alike, it may stall as much as a quarter above.

    **Source:** Jindal et al. 2021, Eq. 31, for the product; Lawson and Hanson 1974,
    Solving Least Squares Problems, ch. 23, for the programmes, in their duals.
    """
    *tables, rates, n = target.shape
    ordered = _Order.of(order, rates)
    pairs = motion[:, :, None] * light[:, None, :]
    gram = jnp.einsum("nij,nkl->ijkl", pairs, pairs, precision=_EXACT)
    grids = _Grids(grid_motion, grid_light, *map(_constant, (grid_motion, grid_light)))

    def fit(of_table: Float[Array, "rates n"]) -> tuple[Array, Array]:
        moments = jnp.einsum("nij,rn->rij", pairs, of_table, precision=_EXACT)
        problem = _Problem(gram, moments, jnp.sum(of_table**2))
        a, b = _alternate(problem, grids, ordered.differences, margin)
        return _raised_product(a, b, problem, grids, ordered, margin)

    a, b = jax.lax.map(fit, target.reshape(-1, rates, n))
    return a.reshape(*tables, rates, -1), b.reshape(*tables, rates, -1)


class _Grids(NamedTuple):
    """Both factors' functions where the order must hold, and the coefficients of 1."""

    motion: Float[Array, "m d"]
    light: Float[Array, "m e"]
    one_motion: Float[Array, " d"]
    one_light: Float[Array, " e"]


class _Problem(NamedTuple):
    """The sum of squares as a function of both factors."""

    gram: Float[Array, "d e d e"]
    moments: Float[Array, "rates d e"]
    square: Float[Array, ""]

    def apart(
        self, rate: int, a: Float[Array, " d"], b: Float[Array, " e"]
    ) -> Float[Array, ""]:
        """The sum of squares of one rate, but for what its target adds to any."""
        both = a[:, None] * b[None, :]
        fitted = jnp.einsum("ij,ijkl,kl->", both, self.gram, both, precision=_EXACT)
        return fitted - 2 * jnp.sum(self.moments[rate] * both)


class _Active(NamedTuple):
    """Places where the order binds, and how hard it pulls there."""

    place: Int[Array, " most"]
    on: Bool[Array, " most"]
    pull: Float[Array, " most"]

    @classmethod
    def none(cls, most: int, dtype) -> "_Active":
        zeros = jnp.zeros(most, dtype)
        return cls(jnp.zeros(most, int), jnp.zeros(most, bool), zeros)


class _Round(NamedTuple):
    a: Float[Array, "rates d"]
    b: Float[Array, "rates e"]
    active_a: _Active
    active_b: _Active
    left: Float[Array, ""]
    rounds: Int[Array, ""]
    done: Bool[Array, ""]


def _alternate(
    problem: _Problem,
    grids: _Grids,
    differences: Float[np.ndarray, "pairs rates"],
    margin: float,
) -> tuple[Float[Array, "rates d"], Float[Array, "rates e"]]:
    """Both factors, each the best for the other, from the free ones."""
    gram, moments, square = problem
    rates, d, e = moments.shape
    dtype = moments.dtype
    rounding = 10 * jnp.finfo(dtype).eps * square

    def one_round(r: _Round) -> _Round:
        light = jnp.matmul(r.b, grids.light.T, precision=_EXACT)
        normal = jnp.einsum("ijkl,rj,rl->rik", gram, r.b, r.b, precision=_EXACT)
        right = jnp.einsum("rij,rj->ri", moments, r.b, precision=_EXACT)
        bounds = _Bounds(grids.motion, light, differences, margin)
        a, active_a = _nearest(normal, right, bounds, r.active_a)

        motion = jnp.matmul(a, grids.motion.T, precision=_EXACT)
        normal = jnp.einsum("ijkl,ri,rk->rjl", gram, a, a, precision=_EXACT)
        right = jnp.einsum("rij,ri->rj", moments, a, precision=_EXACT)
        bounds = _Bounds(grids.light, motion, differences, margin)
        b, active_b = _nearest(normal, right, bounds, r.active_b)

        fitted = jnp.einsum("rjl,rj,rl->", normal, b, b, precision=_EXACT)
        left = square + fitted - 2 * jnp.sum(right * b)
        done = r.left - left <= _LITTLE * left + rounding
        peak = jnp.max(jnp.abs(jnp.matmul(b, grids.light.T, precision=_EXACT)), axis=1)
        peak = jnp.where(peak > 0, peak, 1)[:, None]
        return _Round(a * peak, b / peak, active_a, active_b, left, r.rounds + 1, done)

    start = _Round(
        a=jnp.zeros((rates, d), dtype),
        b=_free_light(moments, grids),
        active_a=_Active.none(rates * d, dtype),
        active_b=_Active.none(rates * e, dtype),
        left=jnp.asarray(jnp.inf, dtype),
        rounds=jnp.zeros((), int),
        done=jnp.asarray(False),
    )
    going = lambda r: ~r.done & (r.rounds < _MOST_ROUNDS)
    end = jax.lax.while_loop(going, one_round, start)
    return end.a, end.b


def _free_light(
    moments: Float[Array, "rates d e"], grids: _Grids
) -> Float[Array, "rates e"]:
    """The second factor without an order, but > 0: then the first can keep any."""
    _, _, right = jnp.linalg.svd(moments, full_matrices=False)
    b, one = right[:, 0], jnp.broadcast_to(grids.one_light, right[:, 0].shape)
    value = jnp.matmul(b, grids.light.T, precision=_EXACT)
    sign = jnp.where(jnp.sum(value, axis=1) < 0, -1, 1).astype(b.dtype)[:, None]
    high = jnp.max(jnp.abs(value), axis=1, keepdims=True)
    low = jnp.min(sign * value, axis=1, keepdims=True)
    lacks = jnp.maximum(_LOWEST * high - low, 0) / (1 - _LOWEST)
    raised = (sign * b + lacks * one) / jnp.where(high > 0, high + lacks, 1)
    return jnp.where(high > 0, raised, one)


class _Bounds(NamedTuple):
    """Differences of `weight` times the functions, no less than `margin`."""

    grid: Float[Array, "m d"]
    weight: Float[Array, "rates m"]
    differences: Float[np.ndarray, "pairs rates"]
    margin: float


class _Set(NamedTuple):
    active: _Active
    steps: Int[Array, ""]
    done: Bool[Array, ""]


def _nearest(
    normal: Float[Array, "rates d d"],
    right: Float[Array, "rates d"],
    bounds: _Bounds,
    start: _Active,
) -> tuple[Float[Array, "rates d"], _Active]:
    """Least squares within bounds, and where these bind.

    The dual has one unknown, >= 0, a place. Those that are not 0 are solved for; any
    that would become negative are dropped, or else the worst place is added.
    """
    grid, weight, differences, margin = bounds
    d, m, dtype = grid.shape[1], grid.shape[0], right.dtype
    eps = float(jnp.finfo(dtype).eps)
    difference = jnp.asarray(differences, dtype)
    ridge = eps * jnp.trace(normal, axis1=1, axis2=2)
    ridge = jnp.where(ridge > 0, ridge, 1)[:, None, None]
    inverse = jnp.linalg.inv(normal + ridge * jnp.eye(d, dtype=dtype)[None])
    free = jnp.einsum("rij,rj->ri", inverse, right, precision=_EXACT)

    def made(x: Array) -> Array:
        value = jnp.matmul(x, grid.T, precision=_EXACT) * weight
        return difference @ value

    at_free = made(free)
    small = jnp.maximum(0.25 * margin, 20 * eps * jnp.max(jnp.abs(at_free)))
    # What is left may be `small`, and nothing of it below the margin.
    needed_at = (margin + small - at_free).ravel()
    square = jnp.einsum("rij,mi,mj->rm", inverse, grid, grid, precision=_EXACT)
    square = jnp.abs(difference) @ (square * weight**2)
    per_length = jax.lax.rsqrt(jnp.maximum(square, eps * jnp.max(square)))

    def solved(active: _Active) -> tuple[Array, Array]:
        """How hard each place pulls to be met, and what that moves for a unit each."""
        pair, point = active.place // m, active.place % m
        share = difference[pair] * weight[:, point].T
        share = jnp.where(active.on[:, None], share, 0)
        rows = share[:, :, None] * grid[point][:, None, :]
        moved = jnp.einsum("rij,prj->pri", inverse, rows, precision=_EXACT)
        both = jnp.einsum("pri,qri->pq", rows, moved, precision=_EXACT)
        length = jnp.diagonal(both)
        length = jnp.sqrt(jnp.where(length > 0, length, 1))
        both = both / length[:, None] / length[None, :]
        both = both + jnp.diag(jnp.where(active.on, 20 * eps, 1).astype(dtype))
        needed = jnp.where(active.on, needed_at[active.place], 0) / length
        factor = jnp.linalg.cholesky(both)
        return jax.scipy.linalg.cho_solve((factor, True), needed) / length, moved

    def reached(pull: Array, moved: Array) -> Array:
        return free + jnp.einsum("p,pri->ri", pull, moved, precision=_EXACT)

    def one_set(s: _Set) -> _Set:
        now = s.active
        pull, moved = solved(now)
        wrong = now.on & ~(pull > 0)
        some = jnp.any(wrong)
        lacks = margin + small - made(reached(pull, moved))
        longer = _longer(now._replace(pull=pull), lacks, per_length, small)
        shorter = _shorter(now, pull, wrong)
        chosen = jax.tree.map(lambda a, b: jnp.where(some, a, b), shorter, longer)
        return _Set(chosen, s.steps + 1, jnp.all(chosen.on == now.on))

    none = jnp.zeros((), int)
    going = lambda s: ~s.done & (s.steps < _MOST_SETS)
    end = jax.lax.while_loop(going, one_set, _Set(start, none, jnp.asarray(False)))
    _, moved = solved(end.active)
    return reached(end.active.pull, moved), end.active


def _shorter(
    now: _Active, pull: Float[Array, " most"], wrong: Bool[Array, " most"]
) -> _Active:
    """As far towards `pull` as none becomes negative, without those that are 0 then."""
    way = jnp.where(wrong, now.pull / jnp.where(wrong, now.pull - pull, 1), 1)
    # 0 / 0 where a place neither pulls nor should.
    way = jnp.where(wrong & (now.pull == 0), 0, way)
    step = jnp.min(way)
    kept = now.on & ~(wrong & (way <= step))
    partly = now.pull + step * (pull - now.pull)
    return _Active(now.place, kept, jnp.where(kept, jnp.maximum(partly, 0), 0))


def _longer(
    now: _Active,
    lacks: Float[Array, "pairs m"],
    per_length: Float[Array, "pairs m"],
    small: Float[Array, ""],
) -> _Active:
    """With the place that lacks most for how far it can be moved, if there is room."""
    place = jnp.argmax(jnp.where(lacks > small, lacks * per_length, -1))
    known = jnp.any((place == now.place) & now.on)
    room = jnp.argmin(now.on)
    new = (lacks.ravel()[place] > small) & ~known & ~now.on[room]
    here = new & (jnp.arange(now.place.size) == room)
    return _Active(
        jnp.where(here, place, now.place), now.on | here, jnp.where(here, 0, now.pull)
    )


def _raised_product(
    a: Float[Array, "rates d"],
    b: Float[Array, "rates e"],
    problem: _Problem,
    grids: _Grids,
    order: _Order,
    margin: float,
) -> tuple[Float[Array, "rates d"], Float[Array, "rates e"]]:
    """Every rate's first factor raised by what it lacks, the worse rates first.

    A rate becomes one number, the least that its bounds allow, if its second factor is
    somewhere not > 0 and it lacks anything, or if that is nearer to its target: where
    all of a rate sits on its bound, single precision may stop far from there.
    """
    found: dict[int, tuple[Array, Array]] = {}
    value = {-1: jnp.zeros(grids.motion.shape[0], a.dtype)}
    at = lambda c, grid: jnp.matmul(grid, c, precision=_EXACT)
    for k, worse in order.rising:
        first, second = a[k], b[k]
        if worse:
            light = at(second, grids.light)
            lowest = jnp.max(jnp.stack([value[w] for w in worse]), axis=0) + margin
            lacks = lowest - at(first, grids.motion) * light
            usable = jnp.min(light) > _USABLE
            by = jnp.maximum(jnp.max(lacks / jnp.where(usable, light, 1)), 0)
            raised = first + jnp.where(usable, by, 0) * grids.one_motion
            flat = jnp.max(lowest) * grids.one_motion
            nearer = problem.apart(k, flat, grids.one_light) < problem.apart(
                k, raised, second
            )
            alone = nearer | (~usable & jnp.any(lacks > 0))
            first = jnp.where(alone, flat, raised)
            second = jnp.where(alone, grids.one_light, second)
        product = at(first, grids.motion) * at(second, grids.light)
        found[k], value[k] = (first, second), product
    factors = [found[k] for k in range(a.shape[0])]
    return jnp.stack([x for x, _ in factors]), jnp.stack([x for _, x in factors])

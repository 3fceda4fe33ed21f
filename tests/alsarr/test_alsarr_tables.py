"""How a tile is looked up in tables, and what they know of themselves."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import RATES
from alsarr.tables import (
    Certificate,
    Conditions,
    Domain,
    Eq31,
    Eq31LogTravel,
    QualityTables,
    TablesJindal2021,
    TensorPolynomial,
)
from alsarr.tables._tables import index_entries


X64 = jax.config.read("jax_enable_x64")
DOMAIN = Domain(
    velocity=(0.0, 50.0),
    refresh_rate=(30.0, 120.0),
    log10_luminance=(-1.0, float(np.log10(300.0))),
)
SIZES = np.array([1, 0.1, 0.01, 1e-3, 1e-3, 1e-4, 0.01, 0.1, 1, 1])
TENSOR = TensorPolynomial((2, 1, 2), 0.5 / 60)


def drawn(basis, shape, seed=0):
    x = np.random.default_rng(seed).normal(size=(*shape, basis.num_coefficients))
    return x if isinstance(basis, TensorPolynomial) else x * SIZES


# Brick at levels 0, 1 and 3, grass at 0 and 3, and no sky.
OWNERS = [(0, (0.0,)), (0, (1.0,)), (0, (3.0,)), (1, (0.0,)), (1, (3.0,))]


def tables(basis=None, *, directions=2, rates=RATES.names, **changes):
    basis = basis or Eq31()
    shape = (len(OWNERS), len(rates), directions)
    levels = (0.0, 1.0, 3.0)
    entry, occurs = index_entries(3, levels, OWNERS)
    zero = jnp.zeros(2)
    values = {
        "coefficients": drawn(basis, shape),
        "entry": entry,
        "occurs": occurs,
        "constant": np.zeros(len(OWNERS), bool),
        "mip_levels": levels,
        "domain": DOMAIN,
        "certificate": Certificate(
            largest=np.zeros(shape),
            percentile_99=np.zeros(shape),
            median=np.zeros(shape),
            overall=np.array([0.25, 0.125, 0.0625]),
            sample=Conditions(zero, zero + 60, zero),
        ),
        "basis": basis,
        "rates": rates,
        "texture_names": ("brick", "grass", "sky"),
        "model": "camojab 0.1.0, a display",
        "relative_to": rates[0],
    }
    return QualityTables(**(values | changes))


CONDITIONS = {
    "mip_level": [0.0, 1.0, 0.4, 2.0, 2.1, 9.0],
    "velocity_x": [0.0, 3.0, 50.0, 80.0, 7.0, 7.0],
    "velocity_y": [1.0, 0.0, 49.0, 2.0, 90.0, 7.0],
    "luminance": [0.1, 50.0, 300.0, 300.0, 0.0, 1e4],
}
TEXTURE = np.array([0, 1, 1, 0, 0, 1])
# Of the texture's own levels the one that serves: nearest of (0, 1, 3), the finer of
# two, and where the texture has no such level the nearest that it has.
ENTRY = [0, 3, 3, 1, 2, 4]


def conditions(**changes):
    given = CONDITIONS | changes
    return {n: jnp.asarray(np.broadcast_to(x, 6), float) for n, x in given.items()}


def hertz(f):
    return jnp.asarray(f, float)


def looked_up(table, refresh_rate=60.0, texture=TEXTURE, **changes):
    given = conditions(**changes)
    return table.quality(
        jnp.asarray(texture), refresh_rate=hertz(refresh_rate), **given
    )


def eq31(w, v, f, level):
    motion = w[0] + w[1] * v + w[2] * f + w[3] * v**2 + w[4] * v * f + w[5] * f**2
    return motion * (w[6] * level**3 + w[7] * level**2 + w[8] * level + w[9])


def by_hand(table, refresh_rate, place=lambda k: (k, k)):
    """Quality of Eq. 31 in each tile and rate; `place` of the rate for x and y."""
    w = np.asarray(table.coefficients, float)
    f = np.clip(refresh_rate, 30, 120)
    expected = np.empty((6, 7))
    for i in range(6):
        light = np.log10(np.clip(CONDITIONS["luminance"][i], 0.1, 300))
        for k in range(7):
            both = [
                eq31(w[ENTRY[i], at, min(d, w.shape[2] - 1)], min(v, 50.0), f, light)
                for d, at in enumerate(place(k))
                for v in [CONDITIONS[f"velocity_{'xy'[d]}"][i]]
            ]
            expected[i, k] = np.mean(both)
    return expected


TOLERANCE = 1e-11 if X64 else 5e-5


@pytest.mark.parametrize("directions", [2, 1])
@pytest.mark.parametrize("refresh_rate", [10.0, 60.0, 240.0])
def test_quality_is_the_mean_of_both_directions_inside_the_domain(
    refresh_rate, directions
):
    table = tables(directions=directions)
    got = looked_up(table, refresh_rate)
    assert got.dtype == table.dtype == jnp.result_type(float)
    expected = by_hand(table, refresh_rate)
    np.testing.assert_allclose(got, expected, rtol=TOLERANCE, atol=TOLERANCE)


@pytest.mark.parametrize("basis", [Eq31LogTravel(), TENSOR], ids=lambda b: b.name)
@pytest.mark.parametrize("directions", [2, 1])
def test_every_form_is_looked_up_alike(basis, directions):
    table = tables(basis, directions=directions)
    got = looked_up(table, 75.0)
    for i in range(6):
        light = np.log10(np.clip(CONDITIONS["luminance"][i], 0.1, 300))
        velocity = [min(CONDITIONS[f"velocity_{a}"][i], 50.0) for a in "xy"]
        at = [Conditions(*map(hertz, (v, 75.0, light))) for v in velocity]
        ways = [0, directions - 1]
        for k in (0, 3, 6):
            both = [
                basis.evaluate(table.coefficients[ENTRY[i], k, d], where, DOMAIN)
                for d, where in zip(ways, at, strict=True)
            ]
            np.testing.assert_allclose(
                got[i, k], np.mean(both), rtol=TOLERANCE, atol=TOLERANCE
            )


def test_an_absent_rate_is_the_nearest_finer_one():
    """Of 4x4, 2x4, 4x2, 2x2, 1x2, 2x1 and 1x1 there are 2x2, 2x1 and 1x1."""
    table = tables(rates=("2x2", "2x1", "1x1"))
    stand_in = [0, 0, 0, 0, 2, 1, 2]
    expected = by_hand(table, 60.0, lambda k: (stand_in[k],) * 2)
    np.testing.assert_allclose(
        looked_up(table), expected, rtol=TOLERANCE, atol=TOLERANCE
    )


def test_separable_tables_take_the_side_along_the_motion():
    table = tables(rates=("4", "2", "1"))
    side = {"4": 0, "2": 1, "1": 2}
    place = lambda k: tuple(side[s] for s in RATES.names[k].split("x"))
    expected = by_hand(table, 60.0, place)
    np.testing.assert_allclose(
        looked_up(table), expected, rtol=TOLERANCE, atol=TOLERANCE
    )


@pytest.mark.parametrize("tiles", [8192 + 5, 2 * 8192])
def test_more_tiles_than_a_block_are_the_same_as_some_at_a_time(tiles):
    """Tiles all differ, so none can take the place of another."""
    table, rng = tables(), np.random.default_rng(tiles)
    texture = jnp.asarray(rng.integers(0, 2, tiles))
    ends = ((0, 4), (0, 50), (0, 50), (0.1, 300))
    given = [jnp.asarray(rng.uniform(*end, tiles), float) for end in ends]
    got = table.quality(texture, *given, hertz(60))
    parts = [
        table.quality(texture[part], *(x[part] for x in given), hertz(60))
        for part in (slice(i, i + 4096) for i in range(0, tiles, 4096))
    ]
    # Blocks are compiled, and may round what is done step by step otherwise.
    np.testing.assert_allclose(
        got, jnp.concatenate(parts), rtol=TOLERANCE, atol=TOLERANCE
    )
    assert len(np.unique(np.asarray(got), axis=0)) == tiles


def test_conditions_outside_are_told_apart():
    table = tables()
    of = lambda rate=60.0, **given: table.outside(
        jnp.asarray(TEXTURE), refresh_rate=hertz(rate), **conditions(**given)
    )
    # Grass has no level 1; then too fast in x, too fast in y and too dark, too bright
    # and too coarse. The ends of the domain are inside.
    np.testing.assert_array_equal(of(), [False, True, False, True, True, True])
    inside = {"velocity_x": 7.0, "velocity_y": 7.0, "luminance": 50.0}
    every = lambda **given: of(**(inside | given)).tolist()
    assert every(mip_level=3.0) == [False] * 6
    grass = [False, True, True, False, False, True]
    assert every(mip_level=1.0) == grass
    for one in ({"velocity_x": 50.01}, {"velocity_y": 51.0}, {"luminance": 301.0}):
        assert every(mip_level=0.0, **one) == [True] * 6
    assert every(mip_level=0.0, luminance=0.09) == [True] * 6
    for rate, outside in ((29.9, True), (30.0, False), (120.0, False), (121.0, True)):
        assert every(rate=rate, mip_level=0.0) == [outside] * 6
    # Levels that round to 3 are inside, as those that round to any other are.
    assert every(mip_level=3.5) == [False] * 6
    assert every(mip_level=3.6) == [True] * 6


def test_levels_below_the_lowest_are_outside_where_they_do_not_round_to_it():
    table = tables(coefficients=drawn(Eq31(), (5, 7, 2)), mip_levels=(1.0, 2.0, 4.0))
    level = jnp.array([0.4, 0.5, 0.6, 1.0, 4.5, 4.6])
    got = table.outside(
        jnp.zeros(6, int),
        level,
        *(jnp.full(6, x) for x in (3.0, 3.0, 50.0)),
        hertz(60),
    )
    assert got.tolist() == [True, True, False, False, False, True]


def test_textures_that_do_not_occur():
    table = tables()
    assert table.holds(jnp.array([0, 1, 2, 3])).tolist() == [True, True, False, False]
    got = looked_up(table, texture=np.array([2, 0, 2, 1, 2, 2]))
    assert np.isnan(np.asarray(got)[[0, 2, 4, 5]]).all()
    assert np.isfinite(np.asarray(got)[[1, 3]]).all()
    outside = table.outside(
        jnp.full(6, 2), refresh_rate=hertz(60), **conditions(mip_level=0.0)
    )
    assert outside.all()


def test_polynomial_of_a_texture_at_the_nearest_levels():
    table = tables()
    got = table.polynomial("grass", jnp.array([0.0, 1.0, 2.4, 7.0]))
    np.testing.assert_array_equal(got, table.coefficients[jnp.array([3, 3, 4, 4])])


def test_dense_tables_have_every_whole_level_from_zero():
    table = tables()
    dense = table.dense()
    assert dense.shape == (2, 3, 4, 7, 10) and dense.dtype == np.float32
    w = np.asarray(table.coefficients, np.float32)
    # 2 is as near to 1 as to 3, and the finer is taken; grass has no level 1.
    for texture, entries in enumerate([[0, 1, 1, 2], [3, 3, 3, 4]]):
        expected = np.moveaxis(w[entries], 2, 0)
        np.testing.assert_array_equal(dense[:, texture], expected)
    np.testing.assert_array_equal(dense[:, 2], 0)
    half = tables(mip_levels=(0.0, 0.5, 3.0))
    with pytest.raises(ValueError, match=r"whole numbers, got \[0.0, 0.5, 3.0\]"):
        half.dense()


def test_numbers_are_counted_and_a_constant_is_one():
    assert tables().count == 5 * 7 * 2 * 10
    assert tables(directions=1).count == 5 * 7 * 10
    assert tables(constant=np.arange(5) > 2).count == 3 * 7 * 2 * 10 + 2
    assert tables(TENSOR, constant=np.ones(5, bool)).count == 5


def test_meets_says_whether_the_tolerance_is_met():
    assert tables().meets is None
    assert tables(tolerance_jnd=0.25).meets is True
    assert tables(tolerance_jnd=0.24).meets is False
    assert (tables().largest_error, tables().median_error) == (0.25, 0.0625)


def test_entries_are_indexed_by_texture_and_nearest_level():
    entry, occurs = index_entries(
        4, (0.0, 1.0, 2.0, 5.0), [(2, (1.0, 5.0)), (0, (0.0,)), (2, (0.0,))]
    )
    np.testing.assert_array_equal(
        entry, [[1, 1, 1, 1], [-1] * 4, [2, 0, 0, 0], [-1] * 4]
    )
    np.testing.assert_array_equal(
        occurs, [[1, 0, 0, 0], [0] * 4, [1, 1, 0, 1], [0] * 4]
    )


@pytest.mark.parametrize(
    "owners, message",
    [
        ([(0, (2.0,))], "one of the mip levels, got 0 at 2"),
        ([(0, (0.0,)), (0, (0.0,))], "one entry for a texture and one of the mip"),
        ([(0, ())], r"must each have a mip level and one of 1 textures, got 0 at \(\)"),
        ([(1, (0.0,))], r"one of 1 textures, got 1 at \(0.0,\)"),
        ([(-1, (0.0,))], "one of 1 textures, got -1"),
    ],
)
def test_entries_that_cannot_be_indexed(owners, message):
    with pytest.raises(ValueError, match=message):
        index_entries(1, (0.0, 1.0), owners)


@pytest.mark.parametrize(
    "basis", [Eq31(), Eq31LogTravel(), TENSOR], ids=lambda b: b.name
)
def test_gradients_are_finite_in_the_dark_and_at_the_ends(basis):
    table = tables(basis)

    @jax.jit
    def total(velocity_x, luminance, refresh_rate):
        values = conditions() | {"velocity_x": velocity_x, "luminance": luminance}
        quality = table.quality(
            jnp.asarray(TEXTURE), refresh_rate=refresh_rate, **values
        )
        return jnp.sum(quality)

    given = conditions()
    for rate in (30.0, 60.0, 120.0):
        gradients = jax.grad(total, argnums=(0, 1, 2))(
            given["velocity_x"], given["luminance"], hertz(rate)
        )
        assert all(np.isfinite(g).all() for g in gradients)
        assert np.any(gradients[0] != 0) and gradients[2] != 0
        # What is moved to the edge of the domain does not change.
        assert gradients[0][3] == 0 and gradients[1][4] == 0


@pytest.mark.parametrize(
    "changes, message",
    [
        (
            {"texture_names": ("brick",)},
            r"`entry` must have shape \(1, 3\) .*got \(3, 3\)",
        ),
        ({"mip_levels": (0.0, 1.0)}, r"`entry` must have shape \(3, 2\) .*got \(3, 3"),
        ({"occurs": np.ones((3, 2), bool)}, r"`occurs` must have shape \(3, 3\)"),
        ({"constant": np.zeros(4, bool)}, r"`coefficients` must have shape \(4, 7, 2"),
        ({"basis": TENSOR}, r"must have shape \(5, 7, 2, 18\) .*got \(5, 7, 2, 10\)"),
        (
            {"coefficients": np.zeros((5, 7, 3, 10))},
            r"`coefficients` must have shape .*got \(5, 7, 3, 10\)",
        ),
        (
            {"rates": ("2x2", "1x1"), "relative_to": "2x2"},
            r"must have shape \(5, 2, 2, 10\)",
        ),
        ({"mip_levels": (0.0, 3.0, 1.0)}, "`mip_levels` must be one or more, rising"),
        ({"mip_levels": (0.0, 1.0, 1.0)}, "`mip_levels` must be one or more, rising"),
        ({"entry": np.full((3, 3), 5)}, "`entry` must be from -1 to 4, got 5 to 5"),
        ({"entry": np.full((3, 3), -2)}, "`entry` must be from -1 to 4, got -2 to -2"),
        ({"relative_to": "8x8"}, "`relative_to` must be one of 4x4, .*, got '8x8'"),
        ({"rates": ("4x4", "2x2")}, "`rates` must be some of .*got 4x4, 2x2"),
        ({"rates": RATES.names[::-1]}, "`rates` must be some of .* in this order"),
        ({"rates": ()}, "`rates` must be some of .*, got none"),
    ],
)
def test_tables_that_do_not_fit_together_are_refused(changes, message):
    good = tables()
    names = [n for n in good.__dataclass_fields__ if n != "mip_levels"]
    given = {n: getattr(good, n) for n in names} | {"mip_levels": (0.0, 1.0, 3.0)}
    with pytest.raises(ValueError, match=message):
        QualityTables(**(given | changes))


def test_the_certificate_has_the_shape_of_the_polynomials():
    good = tables()
    short = eqx.tree_at(lambda c: c.median, good.certificate, jnp.zeros((5, 7, 1)))
    with pytest.raises(ValueError, match=r"`certificate.median` .*\(5, 7, 2\)"):
        tables(certificate=short)


def published(coefficients=None, names=("a", "b")):
    if coefficients is None:
        coefficients = np.random.default_rng(1).normal(size=(2, 12, 2, 10)) * SIZES
    return TablesJindal2021(coefficients, names)


def test_published_tables_work_by_axis():
    table = published()
    got = looked_up(table)
    w = np.asarray(table.coefficients, float)
    for i, level in enumerate([0, 1, 0, 2, 2, 9]):
        light = np.log10(CONDITIONS["luminance"][i] + 0.01)
        half, full = w[TEXTURE[i], level]
        for k, name in enumerate(RATES.names):
            axes = zip(name.split("x"), "xy", strict=True)
            quality = [
                {"4": 0, "2": eq31(half, v, 60, light), "1": eq31(full, v, 60, light)}[
                    side
                ]
                for side, axis in axes
                for v in [CONDITIONS[f"velocity_{axis}"][i]]
            ]
            expected = np.mean(quality) + 0.1
            rtol = 1e-11 if X64 else 1e-4
            np.testing.assert_allclose(got[i, k], expected, rtol=rtol, atol=rtol)


def test_published_tables_limit_the_mip_level_alone():
    table = published()
    beyond, last = (looked_up(table, mip_level=level) for level in (14, 11))
    np.testing.assert_array_equal(beyond, last)
    of = lambda **given: table.outside(
        jnp.asarray(TEXTURE), refresh_rate=hertz(60), **conditions(**given)
    )
    np.testing.assert_array_equal(of(), [False, False, False, True, True, True])
    assert of(mip_level=14).all()
    assert table.holds(jnp.array([0, 1, 2])).tolist() == [True, True, False]


def test_published_tables_must_have_their_shape():
    with pytest.raises(ValueError, match=r"shape \(1, 12, 2, 10\) .*got \(2, 12, 2, 1"):
        published(names=("a",))

"""The model as an oracle: tile by tile what `camojab.quality` says, only faster."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr import Frame, procedural_frame, RATES
from alsarr.oracle import CamojabOracle, TableOracle
from alsarr.oracle._groups import in_blocks
from alsarr.tables import distil, Domain, Form, Grid, sample, Scene, TensorPolynomial
from camojab import (
    Display,
    Exact,
    Formulation,
    Parameters,
    Pooled,
    quality,
    Shading,
    Spectrum,
    Viewing,
)


X64 = jax.config.read("jax_enable_x64")
PPD, PERSISTENCE = 45.0, 0.5


def pictures():
    """Vertical stripes, wider than high, and noise of all frequencies."""
    draw = np.random.default_rng(0)
    stripes = np.repeat(draw.random(64), 7)[None, :] * np.ones((300, 1))
    rough = draw.random((512, 512))
    return {"stripes": 0.9 * stripes + 0.1 * draw.random(stripes.shape), "rough": rough}


PICTURES = pictures()
SPECTRA = {name: Spectrum.from_texture(x) for name, x in PICTURES.items()}
PAIRS = ((0, 0.0), (0, 2.0), (1, 1.0))
DOMAIN = Domain(velocity=(0.0, 20.0), refresh_rate=(50.0, 120.0))
FRAME = Frame(
    texture=np.array([[0, 1, 0], [0, 1, 0]]),
    mip_level=np.array([[0.0, 1, 2], [0, 1, 2]]),
    velocity_x=np.array([[12.0, 0, 3], [0, 30, 8]]),
    velocity_y=np.array([[0.0, 20, 3], [12, 0.5, 1]]),
    luminance=np.array([[100.0, 5, 20], [100, 300, 0.5]]),
)


def oracle(**changes):
    how = {"ppd": PPD, "persistence": PERSISTENCE, "pairs": PAIRS, **changes}
    return CamojabOracle(SPECTRA, **how)


@pytest.fixture(scope="module")
def pooled():
    return oracle()


@pytest.fixture(scope="module")
def exact():
    return oracle(fidelity=Exact())


def one_by_one(frame, rate, **how):
    """Eq. 28 and 29 by the letter: the transposed picture, the sides swapped."""
    found = []
    wide, high = RATES.size.T
    for t, level, vx, vy, light in zip(
        *(np.asarray(x).ravel() for x in jax.tree.leaves(frame)), strict=True
    ):
        picture = list(PICTURES.values())[t]
        display = Display(
            ppd=PPD, refresh_rate=rate, luminance=light, persistence=PERSISTENCE
        )
        along_x = Shading(rate_x=1 / wide, rate_y=1 / high, mip_level=level)
        along_y = Shading(rate_x=1 / high, rate_y=1 / wide, mip_level=level)
        x = quality(
            Spectrum.from_texture(picture), display, Viewing(vx), along_x, **how
        )
        y = quality(
            Spectrum.from_texture(picture.T), display, Viewing(vy), along_y, **how
        )
        found.append((np.asarray(x) + np.asarray(y)) / 2)
    return np.stack(found)


@pytest.fixture(scope="module")
def expected():
    return one_by_one(FRAME, 75.0)


def test_exact_is_the_model_condition_by_condition(exact, expected):
    got = exact.quality(FRAME, 75.0)
    # The transposed picture's transform rounds otherwise than the transposed one.
    np.testing.assert_allclose(got, expected, rtol=1e-9 if X64 else 2e-5)
    assert got.dtype == SPECTRA["rough"].amplitude.dtype
    assert exact.unit == "JND"


def test_pooled_is_within_its_error(pooled, expected):
    """A tenth of a millionth of qualities down to -51 JND when measured."""
    np.testing.assert_allclose(pooled.quality(FRAME, 75.0), expected, atol=1e-4)


def test_own_parameters_are_used(expected):
    changes = {"ws": -1.0, "wt": -4.0, "beta": 0.5, "ca": 0.01}
    how = {"parameters": Parameters(**changes)}
    row = jax.tree.map(lambda x: x[:1, :], FRAME)
    wanted = one_by_one(row, 75.0, **how)
    assert np.abs(wanted - expected[:3]).max() > 1
    np.testing.assert_allclose(
        oracle(**how).quality(FRAME, 75.0)[:3], wanted, atol=0.01
    )


def test_another_formulation_is_used():
    """Its nodes along the motion are others than the radial ones."""
    how = {"formulation": Formulation.PAPER, "fidelity": Pooled(1000)}
    tile = jax.tree.map(lambda x: x[:1, 1:2], FRAME)
    got = oracle(pairs=((1, 1.0),), **how).quality(tile, 75.0)
    np.testing.assert_allclose(got, one_by_one(tile, 75.0, **how), rtol=1e-4)


def test_a_transposed_frame_has_the_transposed_rates(pooled):
    turned = {name: spectrum.transposed() for name, spectrum in SPECTRA.items()}
    other = CamojabOracle(turned, ppd=PPD, persistence=PERSISTENCE, pairs=PAIRS)
    flipped = jax.tree.map(lambda x: x.T, FRAME)
    flipped = eqx.tree_at(
        lambda f: (f.velocity_x, f.velocity_y),
        flipped,
        (flipped.velocity_y, flipped.velocity_x),
    )
    across = [RATES.names.index(name[::-1]) for name in RATES.names]
    assert across == [0, 2, 1, 3, 5, 4, 6]
    here = np.asarray(pooled.quality(FRAME, 75.0)).reshape(2, 3, 7)
    there = np.asarray(other.quality(flipped, 75.0)).reshape(3, 2, 7)
    there = there.transpose(1, 0, 2)[:, :, across]
    np.testing.assert_allclose(here, there, rtol=1e-5, atol=1e-5)


def test_vertical_stripes_know_along_and_across(pooled):
    """Coarse pixels along the motion hide its judder; without any, stripes that are
    too coarse across are what is lost, and motion blurs them across alone."""
    q = lambda rate: dict(zip(RATES.names, pooled.quality(FRAME, rate).T, strict=True))
    in_x, in_y = 0, 3
    slow, fast = q(75.0), q(1000.0)
    assert slow["2x1"][in_x] > slow["1x2"][in_x] + 0.1
    assert slow["2x1"][in_y] < slow["1x2"][in_y] - 0.1
    for tile in (in_x, in_y):
        assert fast["2x1"][tile] < fast["1x2"][tile] - 0.03
        assert fast["4x2"][tile] < fast["2x4"][tile] - 0.1
    assert fast["2x1"][in_y] < fast["2x1"][in_x] - 0.1


def test_levels_that_are_not_modelled_count_as_the_nearest(pooled):
    same = [0.4, 1.0, 2.5, 0.5, 0.6, 1.6]
    near = eqx.tree_at(
        lambda f: f.mip_level, FRAME, jnp.asarray(same, float).reshape(2, 3)
    )
    assert pooled.count_outside(FRAME, 75.0) == 0
    # 0.6 and 1.0, half way between 0 and 2, are levels of the other texture.
    own = jnp.asarray([0.0, 1, 2, 0, 1, 2], float).reshape(2, 3)
    expected = pooled.quality(eqx.tree_at(lambda f: f.mip_level, near, own), 75.0)
    np.testing.assert_array_equal(pooled.quality(near, 75.0), expected)
    assert pooled.count_outside(near, 75.0) == 0
    between = eqx.tree_at(lambda f: f.mip_level, FRAME, jnp.full((2, 3), 1.0))
    assert pooled.count_outside(between, 75.0) == 4
    beyond = eqx.tree_at(lambda f: f.mip_level, FRAME, jnp.full((2, 3), 2.6))
    assert pooled.count_outside(beyond, 75.0) == 6
    dark = eqx.tree_at(lambda f: f.luminance, FRAME, FRAME.luminance / 1000)
    assert pooled.count_outside(dark, 75.0) == 1


def test_tables_of_the_same_texture_are_near(pooled):
    """As near as the certificate of the tables says."""
    samples = sample(
        SPECTRA,
        Scene(2, ((1, 1.0),), DOMAIN),
        ppd=PPD,
        persistence=PERSISTENCE,
        grid=Grid.over(DOMAIN, (7, 5, 5)),
    )
    tables = distil(samples, Form(TensorPolynomial((3, 2, 3), 0.5 / PPD)))
    draw = np.random.default_rng(0)
    frame = Frame(
        texture=np.ones((2, 3)),
        mip_level=np.ones((2, 3)),
        velocity_x=draw.uniform(0, 20, (2, 3)),
        velocity_y=draw.uniform(0, 20, (2, 3)),
        luminance=10 ** draw.uniform(*DOMAIN.log10_luminance, (2, 3)),
    )
    of_model = np.asarray(pooled.quality(frame, 75.0))
    looked_up = eqx.filter_jit(TableOracle.quality)
    of_tables = np.asarray(looked_up(TableOracle(tables), frame, 75.0))
    error = np.abs(of_tables - (of_model - of_model[:, :1])).max()
    assert error <= float(tables.largest_error) < 1
    assert np.ptp(of_model) > 20


def shuffled(frame):
    return jax.tree.map(lambda x: x[::-1, ::-1], frame)


def test_mapped_over_rates_in_one_compilation(pooled):
    """As the controller calls it: what each would give alone."""

    def every(model, frame, rates):
        return jax.vmap(lambda rate: model.quality(frame, rate))(rates)

    compiled = eqx.filter_jit(eqx.debug.assert_max_traces(every, max_traces=1))
    for frame, rates in ((FRAME, [30.0, 75.0]), (shuffled(FRAME), [60.0, 144.0])):
        got = compiled(pooled, frame, jnp.asarray(rates))
        alone = np.stack([pooled.quality(frame, rate) for rate in rates])
        np.testing.assert_allclose(got, alone, rtol=1e-5, atol=1e-5)
    unknown = eqx.tree_at(lambda f: f.texture, FRAME, FRAME.texture + 1)
    with pytest.raises(RuntimeError, match="`frame.texture` must be a texture that is"):
        compiled(pooled, unknown, jnp.asarray([30.0, 75.0]))


def test_mapped_over_frames(pooled, exact):
    both = FRAME, shuffled(FRAME)
    frames = jax.tree.map(lambda *x: jnp.stack(x), *both)

    @eqx.filter_jit
    def every(model, frames, rate):
        return jax.vmap(lambda frame: model.quality(frame, rate))(frames)

    alone = np.stack([pooled.quality(frame, 75.0) for frame in both])
    got = every(pooled, frames, jnp.asarray(75.0))
    np.testing.assert_allclose(got, alone, rtol=1e-5, atol=1e-5)
    # The same path but for the pools, of which compiling takes as long as all above.
    traced = eqx.filter_eval_shape(every, exact, frames, jnp.asarray(75.0))
    assert traced.shape == (2, 6, 7)


def test_extremes_are_finite_and_have_finite_derivatives(pooled):
    ends = Frame(
        texture=np.array([[0, 1, 0], [0, 1, 0]]),
        mip_level=np.array([[0.0, 1, 2], [0, 1, 2]]),
        velocity_x=np.array([[0.0, 0, 1000], [1e-6, 0.1, 1e4]]),
        velocity_y=np.array([[0.0, 1000, 0], [1e-6, 0.1, 1e4]]),
        luminance=np.array([[0.0, 1e-7, 1e4], [1e-3, 1e6, 50]]),
    )

    @eqx.filter_jit
    def both(o, frame, rate):
        def total(moved):
            q = o.quality(moved, rate)
            return jnp.sum(q), q

        of = lambda v, w, light: total(
            eqx.tree_at(
                lambda f: (f.velocity_x, f.velocity_y, f.luminance),
                frame,
                (v, w, light),
            )
        )
        at = frame.velocity_x, frame.velocity_y, frame.luminance
        return jax.value_and_grad(of, argnums=(0, 1, 2), has_aux=True)(*at)

    for rate in (1.0, 60.0, 2000.0):
        (_, q), slopes = both(pooled, ends, jnp.asarray(rate))
        assert np.isfinite(q).all()
        for slope in slopes:
            assert np.isfinite(slope).all()
    _, slopes = both(pooled, FRAME, jnp.asarray(60.0))
    assert all(np.any(np.asarray(slope) != 0) for slope in slopes)
    if X64:
        h = 1e-5
        for name, slope in zip(("velocity_x", "luminance"), slopes[::2], strict=True):
            at = lambda by, name=name: np.sum(
                pooled.quality(
                    eqx.tree_at(
                        lambda f: getattr(f, name), FRAME, getattr(FRAME, name) + by
                    ),
                    60.0,
                ),
                axis=1,
            )
            steps = (at(h)[:2] - at(0.0)[:2]) / h
            # The first two tiles: no whole number of bins is crossed there.
            np.testing.assert_allclose(steps, slope.ravel()[:2], rtol=1e-3, atol=1e-4)


def arrays_within(jaxpr):
    """Shapes of all that is computed, also inside loops and branches."""
    for equation in jaxpr.eqns:
        yield from (variable.aval.shape for variable in equation.outvars)
        for inner in jax.tree.leaves(
            list(equation.params.values()), is_leaf=lambda x: hasattr(x, "eqns")
        ):
            inner = getattr(inner, "jaxpr", inner)
            if hasattr(inner, "eqns"):
                yield from arrays_within(inner)


def test_memory_does_not_grow_with_the_tiles(pooled):
    """Besides the result, some numbers a tile: all settings at once would be 14."""
    frame = procedural_frame(2, rows=68, columns=120, seed=0)
    run = lambda frame, rate: pooled.quality(frame, rate)
    made = jax.make_jaxpr(run)(frame, jnp.asarray(60.0))
    sizes = sorted(np.prod(shape) for shape in arrays_within(made.jaxpr))
    assert len(sizes) > 500 and sizes[-1] < 7.2 * frame.texture.size
    stored = sum(x.nbytes for x in jax.tree.leaves(pooled.settings))
    assert stored / len(PAIRS) < 3e5 * (2 if X64 else 1)


ENTRIES, TILES, SIZE = 5, 23, 4
blocks_of = jax.jit(lambda entry: in_blocks(entry, ENTRIES, SIZE))


@settings(deadline=None, max_examples=60)
@given(st.lists(st.integers(0, ENTRIES - 1), min_size=TILES, max_size=TILES))
def test_every_tile_is_in_a_block_of_its_entry(entry):
    entry = np.array(entry)
    made = jax.tree.map(np.asarray, blocks_of(jnp.asarray(entry)))
    assert made.tile.shape == ((TILES + ENTRIES * (SIZE - 1)) // SIZE, SIZE)
    assert len(set(made.place.tolist())) == TILES
    np.testing.assert_array_equal(made.tile.ravel()[made.place], np.arange(TILES))
    of_place = made.place // SIZE
    np.testing.assert_array_equal(made.entry[of_place], entry)
    assert made.used[of_place].all()
    counts = np.bincount(entry, minlength=ENTRIES)
    assert made.used.sum() == np.sum(-(-counts // SIZE))
    used = made.used
    np.testing.assert_array_equal(
        entry[made.tile[used]], np.repeat(made.entry[used][:, None], SIZE, axis=1)
    )


def test_what_cannot_be_modelled_is_named(pooled):
    for wrong in (2, 7):
        unknown = eqx.tree_at(
            lambda f: f.texture, FRAME, FRAME.texture.at[1, 2].set(wrong)
        )
        rule = f"`frame.texture` must be a texture that is modelled, got {wrong}"
        with pytest.raises(ValueError, match=rule):
            pooled.quality(unknown, 60)
        with pytest.raises(ValueError, match=rule):
            pooled.count_outside(unknown, 60)
    with pytest.raises(ValueError, match="`refresh_rate` must be > 0 Hz and finite"):
        pooled.quality(FRAME, 0)
    with pytest.raises(ValueError, match=r"must be a single number, got shape \(2,\)"):
        pooled.quality(FRAME, jnp.ones(2))
    with pytest.raises(ValueError, match="`textures` must be one or more .* got none"):
        CamojabOracle({}, ppd=PPD)
    half = {**SPECTRA, "c": Spectrum(jnp.zeros((512, 512), jnp.float16))}
    with pytest.raises(ValueError, match="`textures` .* of one dtype, got float16 and"):
        CamojabOracle(half, ppd=PPD)


@pytest.mark.parametrize(
    "changes, rule",
    [
        ({"ppd": 0}, "`ppd` must be finite and > 0 px/deg, got 0"),
        ({"persistence": 1.5}, r"`persistence` must be in \(0, 1\], got 1.5"),
        ({"mip_levels": (0,)}, r"`mip_levels` must be left out .*, got \(0,\)"),
        ({"pairs": ()}, "`pairs` must be one or more, got none"),
        ({"pairs": ((2, 0.0),)}, "`pairs` must have texture indices from 0 to 1"),
        ({"pairs": None, "mip_levels": (1, 0)}, "`mip_levels` must be one or more, r"),
    ],
)
def test_arguments_are_checked_before_anything_is_pooled(changes, rule):
    with pytest.raises(ValueError, match=rule):
        oracle(**changes)

"""What all oracles share, and those that do not look at what the tiles show."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import alsarr.oracle
from alsarr import Frame, RATES
from alsarr.capture import CHANNELS
from alsarr.network import shipped_network
from alsarr.oracle import (
    AbstractQualityOracle,
    CnnOracle,
    Denes2020Oracle,
    FidelityFxOracle,
    TableOracle,
    UniformOracle,
    Yang2019Oracle,
)
from alsarr.tables import TablesJindal2021
from camojab import Display, Shading, Viewing
from camojab.baselines import Denes2020, quality_denes2020


PPD = 50.0
COEFFICIENTS = np.random.default_rng(0).normal(size=(2, 12, 2, 10)) * 0.01
ORACLES = {
    "table": (TableOracle(TablesJindal2021(COEFFICIENTS, ("a", "b"))), "JND"),
    "denes": (Denes2020Oracle(ppd=PPD, persistence=0.6), "JND"),
    "yang": (Yang2019Oracle(ppd=PPD), "just noticeable errors"),
    "fidelityfx": (FidelityFxOracle(ppd=PPD), "luma"),
    "uniform": (UniformOracle(), "octaves"),
    "cnn": (CnnOracle(shipped_network("flip")), "FLIP"),
}


def drawn(seed):
    """Two rows of three tiles."""
    draw = np.random.default_rng(seed)
    return Frame(
        texture=draw.integers(0, 2, (2, 3)),
        mip_level=draw.integers(0, 5, (2, 3)),
        velocity_x=draw.uniform(0, 20, (2, 3)),
        velocity_y=draw.uniform(0, 20, (2, 3)),
        luminance=draw.uniform(1, 100, (2, 3)),
        previous_image=draw.random((32, 48, 3)),
        channels={name: draw.random((32, 48)) for name in CHANNELS},
    )


FRAMES, RATES_HZ = (drawn(0), drawn(1)), (45.0, 120.0)


@pytest.mark.parametrize("name", ORACLES)
def test_mapped_and_compiled_once_is_the_same_as_alone(name):
    oracle, unit = ORACLES[name]
    alone = np.stack(
        [[oracle.quality(frame, rate) for rate in RATES_HZ] for frame in FRAMES]
    )
    assert oracle.unit == unit
    assert alone.shape == (2, 2, 6, 7) and np.isfinite(alone).all()

    compiled = eqx.filter_jit(
        eqx.debug.assert_max_traces(type(oracle).quality, max_traces=1)
    )
    of_rates = jax.jit(
        lambda frame, rates: jax.vmap(lambda rate: oracle.quality(frame, rate))(rates)
    )
    of_frames = jax.jit(
        lambda frames, rate: jax.vmap(lambda frame: oracle.quality(frame, rate))(frames)
    )
    rates, frames = (
        jnp.asarray(RATES_HZ),
        jax.tree.map(lambda *x: jnp.stack(x), *FRAMES),
    )
    near = lambda got, wanted: np.testing.assert_allclose(got, wanted, 1e-5, atol=1e-6)
    for frame, wanted in zip(FRAMES, alone, strict=True):
        near(of_rates(frame, rates), wanted)
        for rate, row in zip(rates, wanted, strict=True):
            near(compiled(oracle, frame, rate), row)
    near(of_frames(frames, rates[0]), alone[:, 0])
    with pytest.raises(RuntimeError, match="`refresh_rate` must be > 0 Hz and finite"):
        compiled(oracle, FRAMES[0], -rates[0])


@pytest.mark.parametrize("name", ORACLES)
@pytest.mark.parametrize("wrong", [0, float("nan"), float("inf")])
def test_a_refresh_rate_must_be_a_positive_number(name, wrong):
    with pytest.raises(ValueError, match="`refresh_rate` must be > 0 Hz and finite"):
        ORACLES[name][0].quality(FRAMES[0], wrong)
    with pytest.raises(ValueError, match=r"must be a single number, got shape \(2,\)"):
        ORACLES[name][0].quality(FRAMES[0], jnp.ones(2))


@pytest.mark.parametrize("name", ORACLES)
def test_what_an_oracle_does_not_know_is_counted(name):
    """Of these the tables alone know less than everything."""
    oracle, frame = ORACLES[name][0], FRAMES[0]
    texture = frame.texture.at[0, 1].set(7).at[1, 1].set(8)
    unknown = eqx.tree_at(lambda f: f.texture, frame, texture)
    for one, expected in ((frame, 0), (unknown, 2)):
        got = oracle.count_outside(one, RATES_HZ[0])
        assert got.shape == () and jnp.issubdtype(got.dtype, jnp.integer)
        assert got == (expected if name == "table" else 0)


def test_every_oracle_is_one_of_the_class():
    kinds = [getattr(alsarr.oracle, name) for name in dir(alsarr.oracle)]
    kinds = [k for k in kinds if isinstance(k, type)]
    # The abstract one and the model's own are not among those above.
    assert len(kinds) == len(ORACLES) + 2
    assert all(issubclass(kind, AbstractQualityOracle) for kind in kinds)


def test_an_oracle_of_ones_own_needs_a_unit():
    class Nameless(AbstractQualityOracle, strict=True):
        def quality(self, frame, refresh_rate):
            return jnp.zeros((frame.texture.size, 7))

        def count_outside(self, frame, refresh_rate):
            return jnp.zeros((), int)

    with pytest.raises(TypeError, match="abstract"):
        Nameless()  # pyright: ignore[reportAbstractUsage]


def test_an_oracle_of_ones_own_must_say_what_it_does_not_know():
    class Careless(AbstractQualityOracle, strict=True):
        unit: ClassVar[str] = "JND"

        def quality(self, frame, refresh_rate):
            return jnp.zeros((frame.texture.size, 7))

    with pytest.raises(TypeError, match="count_outside"):
        Careless()  # pyright: ignore[reportAbstractUsage]


def test_marrr_is_that_of_the_mean_speed():
    oracle, frame = ORACLES["denes"][0], FRAMES[0]
    got = np.asarray(oracle.quality(frame, 90.0))
    speed = np.hypot(np.asarray(frame.velocity_x), np.asarray(frame.velocity_y)).mean()
    display = Display(ppd=PPD, refresh_rate=90, luminance=40, persistence=0.6)
    expected = [
        quality_denes2020(
            display,
            Viewing(speed),
            Shading(rate_x=(m * n) ** -0.5, rate_y=(m * n) ** -0.5),
        )
        for m, n in RATES.size.tolist()
    ]
    np.testing.assert_allclose(got[0], expected, rtol=2e-5)
    np.testing.assert_array_equal(got, np.broadcast_to(got[0], (6, 7)))


def test_marrr_is_sharper_where_more_is_shaded():
    """In JND of which more is better: finer and faster frames gain."""
    oracle, frame = ORACLES["denes"][0], FRAMES[0]
    q = {rate: np.asarray(oracle.quality(frame, rate))[0] for rate in (45.0, 120.0)}
    by_cost = np.unique(RATES.cost, return_index=True)[1]
    assert np.all(np.diff(q[45.0][by_cost]) > 0)
    assert np.all(q[120.0] > q[45.0])
    area = RATES.cost.tolist()
    for i in range(7):
        for j in range(7):
            if area[i] == area[j]:
                assert q[45.0][i] == q[45.0][j]


def test_marrr_takes_constants_and_checks_its_display():
    frame = FRAMES[0]
    of = lambda constants: Denes2020Oracle(ppd=PPD, constants=constants)
    other = of(Denes2020.released(predictable=False)).quality(frame, 60)
    assert np.abs(np.asarray(other) - np.asarray(of(None).quality(frame, 60))).max() > 0
    with pytest.raises(ValueError, match="`ppd` must be finite and > 0 px/deg, got -1"):
        Denes2020Oracle(ppd=-1)
    with pytest.raises(ValueError, match=r"`persistence` must be in \(0, 1\], got 2"):
        Denes2020Oracle(ppd=PPD, persistence=2)


def test_marrr_has_finite_derivatives_at_rest():
    still = jax.tree.map(lambda x: 0 * x, FRAMES[0])

    def total(vx, vy):
        moved = eqx.tree_at(lambda f: (f.velocity_x, f.velocity_y), still, (vx, vy))
        return jnp.sum(ORACLES["denes"][0].quality(moved, 60.0))

    slopes = jax.jit(jax.grad(total, argnums=(0, 1)))(
        still.velocity_x, still.velocity_y
    )
    assert all(np.isfinite(slope).all() for slope in slopes)


def test_uniform_spreads_a_budget_evenly():
    """A pixel is worth most to the coarsest tiles, whatever rate they go to."""
    got = np.asarray(UniformOracle().quality(FRAMES[0], 60.0))
    np.testing.assert_array_equal(got, np.tile([-4.0, -3, -3, -2, -1, -1, 0], (6, 1)))
    worth = {
        (i, j): (got[0, j] - got[0, i]) / (RATES.cost[j] - RATES.cost[i])
        for i in range(7)
        for j in range(7)
        if RATES.cost[j] > RATES.cost[i]
    }
    assert len(worth) == 19
    for (_, j), here in worth.items():
        for (other, _), there in worth.items():
            assert here > there or RATES.cost[other] < RATES.cost[j]

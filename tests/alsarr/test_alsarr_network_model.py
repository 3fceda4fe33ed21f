import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.signal import correlate2d

from alsarr.network import (
    ClampedTransform,
    initial_network,
    pad_to_regions,
    pool_sizes,
)
from alsarr.network._convolution import dense_kernel
from alsarr.network._loss import training_pass
from alsarr.network._pooling import max_pool


RELEASED = (1, 1, 2, 4, 1)
TABLE_3 = (1, 1, 4, 8, 1)
SIX_LAYERS = (1, 1, 2, 4, 8, 1)


def _network(seed=0, **choices):
    """With batch statistics and scales of every sign, as training leaves them."""
    network = initial_network(
        seed, metric="flip", ppd=60.0, transform=ClampedTransform(2.0), **choices
    )
    random = np.random.default_rng(seed)
    draw = lambda low, high, x: jnp.asarray(random.uniform(low, high, x.shape), x.dtype)
    for i, block in enumerate(network.blocks):
        network = eqx.tree_at(
            lambda n, i=i: (
                *(n.blocks[i].mean, n.blocks[i].variance),
                *(n.blocks[i].scale, n.blocks[i].shift),
            ),
            network,
            (
                draw(0, 0.5, block.mean),
                draw(0.05, 1, block.variance),
                draw(-1, 1, block.scale),
                draw(-0.5, 0.5, block.shift),
            ),
        )
    return network


# Compiled once for each shape of network and picture.
_call = eqx.filter_jit(lambda network, x: network(jnp.asarray(x)))
_predict = eqx.filter_jit(lambda network, x, safe=True: network.predict(x, safe=safe))


def _picture(channels=4, height=64, width=48, seed=1):
    random = np.random.default_rng(seed)
    x = random.uniform(0, 1, (channels, height, width)).astype(np.float32)
    x[1] = x[1] > 0.3
    return x


def _plain(network, x):
    """The network written out with SciPy's correlation in double precision."""
    y = np.asarray(x, np.float64).copy()
    seen = y[network.channels.index("seen")].copy()
    for i, name in enumerate(network.channels):
        if name.startswith("reprojected"):
            y[i] *= seen
    for block in network.blocks:
        weight = np.asarray(block.weight, np.float64)
        outs, ins = weight.shape[:2]
        of_group = outs // block.groups
        layer = []
        for o in range(outs):
            first = o // of_group * ins
            planes = [
                correlate2d(y[first + i], weight[o, i], mode="same") for i in range(ins)
            ]
            z = np.maximum(sum(planes) + float(block.bias[o]), 0)
            z = (z - float(block.mean[o])) / math.sqrt(float(block.variance[o]) + 1e-5)
            layer.append(z * float(block.scale[o]) + float(block.shift[o]))
        y = np.stack(layer)
        high, wide = (side // block.pool for side in y.shape[1:])
        y = y.reshape(outs, high, block.pool, wide, block.pool).max(axis=(2, 4))
    return 1 / (1 + np.exp(-y))


@pytest.mark.parametrize(
    "choices",
    [
        {"groups": RELEASED},
        {"groups": TABLE_3},
        {"groups": SIX_LAYERS, "outputs": ("1x2", "2x1")},
        {"groups": RELEASED, "region": 8, "outputs": ("2x2",)},
        {"groups": (1, 2, 1), "region": 4, "latent": 6},
    ],
)
def test_the_network_is_what_scipy_makes_of_its_weights(choices):
    network, x = _network(**choices), _picture()
    got = _call(network, x)
    assert got.shape == (
        len(network.outputs),
        *(s // network.region for s in x.shape[1:]),
    )
    # Five layers of float32 sums of up to 144 terms.
    np.testing.assert_allclose(got, _plain(network, x), atol=2e-6)
    assert np.ptp(got) > 0.02


def test_released_networks_have_as_many_numbers():
    # The released graphs for one metric hold 5077 floats, that of six layers 5594
    # (weights, biases and four of batch normalisation a channel).
    one = initial_network(
        0,
        metric="flip",
        ppd=60.0,
        transform=ClampedTransform(2.0),
        outputs=("2x2",),
        region=8,
    )
    six = initial_network(
        *(0,),
        metric="yang",
        ppd=60.0,
        transform=ClampedTransform(1.0),
        channels=("diffuse_red", "specular_red", "normal_z", "shadow"),
        outputs=("1x2", "2x1"),
        groups=SIX_LAYERS,
    )
    count = lambda n: sum(x.size for x in jax.tree.leaves(n.blocks))
    assert (count(one), count(six)) == (5077, 5594)
    assert [b.pool for b in one.blocks] == [1, 2, 2, 2, 1]
    assert [b.pool for b in six.blocks] == [1, 2, 2, 2, 2, 1]


def _printed(region, layers):
    """Eq. 1 as printed, i = 0 at the second layer."""
    sizes = [1]
    for i in range(layers - 1):
        left = region / 2**i
        sizes.append(2 if left > 2 and i < 5 else math.ceil(left))
    return tuple(sizes)


@pytest.mark.parametrize("region", [1, 2, 4, 8, 16])
def test_pooling_is_the_papers_equation_where_that_makes_the_region(region):
    for layers in (5, 6):
        assert math.prod(_printed(region, layers)) == region
        assert pool_sizes(region, layers) == _printed(region, layers)


def test_pooling_where_the_printed_equation_makes_another_region():
    # What the docstring says of the equation, and what is done instead.
    for region in range(1, 70):
        power = 2 ** math.ceil(math.log2(region))
        assert math.prod(_printed(region, 5)) == min(power, 16)
    assert pool_sizes(12) == (1, 2, 2, 3, 1)
    assert pool_sizes(32) == (1, 2, 2, 2, 4)
    assert pool_sizes(32, 6) == _printed(32, 6) == (1, 2, 2, 2, 2, 2)
    for region in range(1, 70):
        for layers in (2, 3, 5, 8):
            sizes = pool_sizes(region, layers)
            assert math.prod(sizes) == region
            assert len(sizes) == layers and sizes[0] == 1


@pytest.mark.parametrize("region, layers", [(0, 5), (16, 0), (16, 1)])
def test_pooling_that_cannot_be(region, layers):
    with pytest.raises(ValueError, match=r"^`(region|layers)` must be"):
        pool_sizes(region, layers)
    assert pool_sizes(1, 1) == (1,)


@settings(deadline=None, max_examples=8)
@given(st.integers(1, 4), st.integers(1, 3), st.integers(0, 2**31))
def test_pooling_takes_the_largest_of_each_block(size, blocks, seed):
    x = np.random.default_rng(seed).normal(size=(2, size * blocks, size * 2, 3))
    blocked = x.reshape(2, blocks, size, 2, size, 3)
    got = max_pool(jnp.asarray(x), size)
    np.testing.assert_array_equal(got, jnp.asarray(blocked.max(axis=(2, 4))))


@pytest.mark.parametrize("groups", [1, 2, 4])
def test_a_grouped_convolution_is_a_dense_one_with_zeros(groups):
    random = np.random.default_rng(0)
    weight = jnp.asarray(random.normal(size=(8, 8 // groups, 3, 3)), jnp.float32)
    x = jnp.asarray(random.normal(size=(1, 8, 6, 7)), jnp.float32)
    grouped = jax.lax.conv_general_dilated(
        x, weight, (1, 1), "SAME", feature_group_count=groups
    )
    kernel = dense_kernel(weight, groups)
    assert np.count_nonzero(kernel) == weight.size
    dense = jax.lax.conv_general_dilated(x, kernel, (1, 1), "SAME")
    np.testing.assert_allclose(dense, grouped, atol=1e-5)


def test_a_picture_that_ends_within_a_region_goes_on_as_it_was():
    network, x = _network(), _picture(height=40, width=50)
    got = _call(network, x)
    assert got.shape == (4, 3, 4)
    longer = np.pad(x, [(0, 0), (0, 8), (0, 14)], mode="edge")
    np.testing.assert_array_equal(got, _call(network, longer))
    even = jnp.asarray(_picture())
    assert pad_to_regions(even, 16) is even
    flat = jnp.full((4, 37, 21), 0.5, jnp.float32)
    np.testing.assert_array_equal(pad_to_regions(flat, 16), jnp.full((4, 48, 32), 0.5))
    with pytest.raises(ValueError, match="`x` must have pixels, got shape"):
        pad_to_regions(jnp.zeros((4, 0, 16)), 16)


def test_what_was_not_seen_does_not_count():
    network, x = _network(), _picture()
    other = x.copy()
    other[0] = np.where(x[1] == 0, 1 - x[0], x[0])
    np.testing.assert_array_equal(_call(network, x), _call(network, other))
    other[0] = np.where(x[1] == 1, 1 - x[0], x[0])
    assert np.any(_call(network, x) != _call(network, other))
    # Without a mask everything counts.
    blind = dataclasses.replace(network, channels=("a", "b", "c", "d"))
    assert np.any(_call(blind, x) != _call(network, x))


def test_a_network_computes_in_its_own_precision():
    network, x = _network(), _picture()
    wide = jnp.asarray(x, float)
    assert _call(network, wide).dtype == jnp.float32
    assert _predict(network, wide).dtype == jnp.float32
    np.testing.assert_array_equal(_call(network, wide), _call(network, x))


def test_a_prediction_is_in_the_unit_of_the_metric():
    network, x = _network(), jnp.asarray(_picture())
    network = eqx.tree_at(lambda n: n.safety_offset, network, jnp.float32(0.565))
    y = np.asarray(_call(network, x))
    safe = np.asarray(_predict(network, x))
    np.testing.assert_allclose(safe, np.minimum(y + 0.565, 1) / 2, rtol=1e-6)
    assert (y + 0.565 > 1).any() and (y + 0.565 < 1).any()
    np.testing.assert_allclose(_predict(network, x, safe=False), y / 2, rtol=1e-6)


def test_one_compilation_serves_all_weights_and_pictures():
    @eqx.filter_jit
    @eqx.debug.assert_max_traces(max_traces=1)
    def predict(network, x):
        return network.predict(x)

    pictures = jnp.stack([jnp.asarray(_picture(seed=s)) for s in range(2)])
    networks = [_network(0), _network(1)]
    alone = [predict(n, x) for n in networks for x in pictures]
    all_at_once = eqx.filter_jit(lambda n, x: jax.vmap(n.predict)(x))
    together = [all_at_once(n, pictures) for n in networks]
    # Convolutions of a batch may add in another order.
    np.testing.assert_allclose(alone, np.concatenate(together), atol=1e-5)


def test_the_gradient_is_finite_for_a_black_picture():
    network = _network()
    black = jnp.zeros((4, 32, 32), jnp.float32)
    slope = jax.jit(jax.grad(lambda x: jnp.sum(network.predict(x))))(black)
    assert np.isfinite(slope).all()


def test_weights_depend_on_the_seed_alone():
    same, other = _network(3), _network(4)
    again = _network(3)
    for a, b in zip(jax.tree.leaves(same), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)
        assert a.dtype == b.dtype
    assert np.any(same.blocks[0].weight != other.blocks[0].weight)
    bound = 1 / math.sqrt(36)
    first = np.asarray(same.blocks[0].weight)
    assert first.dtype == np.float32 and np.abs(first).max() <= bound
    assert np.abs(first).max() > 0.9 * bound


def test_no_output_is_stopped_before_it_has_learned():
    x = jnp.stack([jnp.asarray(_picture(seed=s)) for s in range(2)])
    statistics = jax.jit(lambda n, x: training_pass(n, x)[1])
    for seed in range(4):
        fresh = initial_network(
            seed, metric="flip", ppd=60.0, transform=ClampedTransform(2.0)
        )
        mean, variance = statistics(fresh, x)[-1]
        # A normal distribution of which half is stopped has a ratio of 0.68.
        assert np.all(np.asarray(mean) > np.sqrt(variance))


@pytest.mark.parametrize(
    "choices, message",
    [
        ({"outputs": ("1x1",)}, r"`outputs` must be some of .*, got \('1x1',\)"),
        ({"outputs": ("1x2", "1x2")}, "`outputs` must be some of"),
        ({"outputs": ()}, "`outputs` must be some of"),
        ({"channels": ("seen", "seen")}, "`channels` must be names, each once"),
        ({"groups": (3, 1, 1, 1, 1)}, r"`groups\[0\]` must divide 4 and 16 channels"),
        ({"groups": (1, 0, 1, 1, 1)}, r"`groups\[1\]` must divide"),
        ({"region": 0}, "`region` must be > 0 px, got 0"),
    ],
)
def test_a_network_that_cannot_be(choices, message):
    with pytest.raises(ValueError, match=message):
        _network(**choices)


def test_layers_that_do_not_fit_are_refused():
    network = _network()
    with pytest.raises(ValueError, match=r"`blocks\[0\]` must have 4 input channels"):
        dataclasses.replace(network, blocks=network.blocks[1:])
    with pytest.raises(ValueError, match="`blocks` must end in 4 channels"):
        dataclasses.replace(network, blocks=network.blocks[:-1])
    with pytest.raises(ValueError, match="`x` must have the 4 channels .*, got 3"):
        network(jnp.zeros((3, 16, 16)))

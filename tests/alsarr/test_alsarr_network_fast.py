"""The network arranged for a CPU against the network as it is."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr.network import ClampedTransform, initial_network
from alsarr.network._convolution import convolved
from alsarr.network._fast import infer
from alsarr.network._model import in_own_unit


CHANNELS = ("reprojected_red", "diffuse_red", "roughness", "seen")
# Sums of some hundred products in float32, in another order; measured 2e-7.
ATOL = 1e-5


@eqx.filter_jit
def called(net, x):
    """Compiled as a whole, which takes less than one operation after the other."""
    return net(x)


@eqx.filter_jit
def predicted(net, x, safe):
    return net.predict(x, safe=safe)


def lively(network, seed=0):
    """With statistics and gains of trained networks: of both signs, far from one."""
    draw = np.random.default_rng(seed)
    blocks = []
    for block in network.blocks:
        n = block.bias.shape[0]
        values = {
            "scale": draw.uniform(-1.5, 1.5, n),
            "shift": draw.uniform(-1, 1, n),
            "mean": draw.uniform(-0.5, 0.5, n),
            "variance": draw.uniform(0.05, 2, n),
        }
        new = [jnp.asarray(v, jnp.float32) for v in values.values()]
        where = lambda b: (b.scale, b.shift, b.mean, b.variance)
        blocks.append(eqx.tree_at(where, block, new))
    return eqx.tree_at(lambda net: net.blocks, network, tuple(blocks))


def network(**settings):
    transform = ClampedTransform(2.0)
    made = eqx.filter_jit(
        lambda: initial_network(
            3, metric="flip", ppd=60.0, transform=transform, **settings
        )
    )()
    made = eqx.tree_at(lambda n: n.safety_offset, made, jnp.float32(0.1))
    return lively(made)


def picture(height, width, seed=1, channels=4):
    draw = np.random.default_rng(seed)
    return jnp.asarray(draw.uniform(-1, 1, (channels, height, width)), jnp.float32)


@pytest.mark.parametrize("size", [(48, 64), (33, 18), (1, 1)])
def test_is_the_network(size):
    net = network()
    x = picture(*size)
    plain, fast = called(net, x), infer(net, x)
    assert fast.dtype == plain.dtype and fast.shape == plain.shape
    assert np.ptp(plain) > 1e-3
    np.testing.assert_allclose(fast, plain, rtol=0, atol=ATOL)


@pytest.mark.parametrize(
    "settings",
    [
        {"groups": (1, 1, 2, 4, 8, 1), "outputs": ("1x2", "2x1")},
        {"groups": (2, 4, 1), "region": 4, "latent": 8},
        {"groups": (1, 1, 1), "region": 6},
        {"groups": (1, 1), "region": 3, "channels": CHANNELS[:3]},
        {"groups": (1,), "region": 1},
    ],
)
def test_every_arrangement_of_layers(settings):
    net = network(**settings)
    x = picture(37, 70, channels=len(net.channels))
    np.testing.assert_allclose(infer(net, x), called(net, x), rtol=0, atol=ATOL)


def test_edges_are_those_of_the_padded_layers():
    """Only at the edge do padding before and after the normalisation differ."""
    net = network()
    x = jnp.zeros((4, 48, 64), jnp.float32)
    plain = np.asarray(called(net, x))
    # What a padding of normalised zeros would miss is there.
    assert abs(plain[:, 1:-1, 1:-1] - plain[:, :1, 1:-1]).max() > 1e-3
    np.testing.assert_allclose(infer(net, x), plain, rtol=0, atol=ATOL)


def test_unit():
    net = network()
    x = picture(48, 64)
    y = infer(net, x)
    for safe in (True, False):
        found = in_own_unit(net, y, safe)
        np.testing.assert_allclose(found, predicted(net, x, safe), atol=ATOL)
    assert np.all(in_own_unit(net, y, True) >= in_own_unit(net, y, False))


def test_products_are_of_the_whole_numbers():
    """Where float32 is multiplied at less precision unless more is asked for."""
    traced = jax.make_jaxpr(lambda x: convolved(x, jnp.ones((3, 3, 4, 2)), 1))(
        jnp.ones((1, 8, 8, 4))
    )
    (found,) = (e for e in traced.eqns if e.primitive.name == "conv_general_dilated")
    assert set(found.params["precision"]) == {jax.lax.Precision.HIGHEST}


def test_transformations():
    net = network(groups=(1, 2, 1), region=4)
    several = jnp.stack([picture(16, 32, seed) for seed in range(2)])
    one_by_one = jnp.stack([called(net, x) for x in several])
    found = jax.jit(jax.vmap(lambda x: infer(net, x)))(several)
    np.testing.assert_allclose(found, one_by_one, rtol=0, atol=ATOL)
    loss = lambda f: jax.jit(jax.grad(lambda x: jnp.sum(f(x) ** 2)))(several[0])
    fast, plain = loss(lambda x: infer(net, x)), loss(net)
    assert float(abs(plain).max()) > 1e-4
    np.testing.assert_allclose(fast, plain, rtol=0, atol=ATOL)


def test_one_compilation_serves_all_weights():
    traces = eqx.debug.assert_max_traces(infer.__wrapped__, max_traces=1)
    call = eqx.filter_jit(traces)
    net = network(groups=(1, 2), region=2)
    for seed in range(3):
        call(lively(net, seed), picture(32, 32, seed))


def test_another_number_of_channels_is_refused():
    with pytest.raises(ValueError, match="must have the 4 channels"):
        infer(network(), picture(16, 16, channels=3))

"""The network behind the oracle's door."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import Frame, RATES, TILE
from alsarr.network import ClampedTransform, initial_network
from alsarr.oracle import AbstractQualityOracle
from alsarr.oracle._cnn import _quality, CnnOracle


ATOL = 1e-5
HEIGHT, WIDTH = 40, 64


def network(**settings):
    """Its predictions differ from tile to tile, and it has a safety offset."""
    default = {"metric": "flip", "ppd": 60.0, "transform": ClampedTransform(2.0)}
    settings = default | settings
    net = eqx.filter_jit(lambda: initial_network(2, **settings))()
    last = net.blocks[-1]
    new = (20 * last.scale, jnp.linspace(-3, -1, len(last.shift), dtype=jnp.float32))
    where = lambda n: (n.blocks[-1].scale, n.blocks[-1].shift, n.blocks[-1].mean)
    net = eqx.tree_at(where, net, (*new, last.bias))
    return eqx.tree_at(lambda n: n.safety_offset, net, jnp.float32(0.05))


@eqx.filter_jit
def predicted(net, x, safe):
    """Compiled as a whole, which takes less than one operation after the other."""
    return net.predict(x, safe=safe)


def buffers(seed=0, height=HEIGHT, width=WIDTH):
    draw = np.random.default_rng(seed)
    names = ("reprojected_red", "seen", "diffuse_red", "normal_z", "roughness")
    values = {name: draw.random((height, width)) for name in names}
    return values | {"seen": np.round(values["seen"])}


def frame(channels, height=HEIGHT, width=WIDTH, velocity=0.0):
    return Frame(
        texture=np.zeros((-(-height // TILE), -(-width // TILE)), int),
        mip_level=0.0,
        velocity_x=velocity,
        velocity_y=velocity,
        luminance=50.0,
        channels=channels,
    )


def stacked(net, channels):
    return jnp.stack([jnp.asarray(channels[n], jnp.float32) for n in net.channels])


def expected_errors(net, channels, safe=True):
    """Section 4.3 and Eq. 10 in NumPy: of each tile, in the order of the rates."""
    found = np.asarray(predicted(net, stacked(net, channels), safe), float)
    e = dict(zip(net.outputs, found.reshape(len(net.outputs), -1), strict=True))
    e["2x2"] = np.maximum(e["1x2"], e["2x1"])
    e.setdefault("2x4", np.maximum(e["2x2"], 2.13 * e["1x2"]))
    e.setdefault("4x2", np.maximum(e["2x2"], 2.13 * e["2x1"]))
    e["4x4"] = np.maximum(e["2x4"], e["4x2"])
    e["1x1"] = np.zeros_like(e["2x2"])
    return np.stack([e[name] for name in RATES.names], axis=1)


@pytest.fixture(scope="module")
def net():
    return network()


@pytest.mark.parametrize("backend", ["jax", "onnxruntime"])
@pytest.mark.parametrize("safe", [True, False])
def test_quality_is_minus_the_predicted_error(net, backend, safe):
    channels = buffers()
    oracle = CnnOracle(net, safe=safe, backend=backend)
    assert isinstance(oracle, AbstractQualityOracle) and oracle.unit == "FLIP"
    quality = oracle.quality(frame(channels), 60.0)
    expected = expected_errors(net, channels, safe)
    assert quality.shape == expected.shape == (12, 7)
    # In the frame's precision, so that solvers take them with its costs.
    assert quality.dtype == jnp.result_type(float)
    assert np.ptp(expected[:, 0]) > 1e-2
    np.testing.assert_allclose(quality, -expected, rtol=0, atol=ATOL)
    assert np.all(np.asarray(quality)[:, -1] == 0)
    assert int(oracle.count_outside(frame(channels), 60.0)) == 0


def test_the_other_backend_leaves_the_cores_to_jax_between_calls(net):
    oracle = CnnOracle(net, backend="onnxruntime", threads=2)
    chosen = oracle.other._session.get_session_options()
    assert chosen.get_session_config_entry("session.intra_op.allow_spinning") == "0"
    assert chosen.intra_op_num_threads == 2


def test_tiles_go_row_by_row(net):
    """What changes in one tile, here the last of the first row, changes that tile."""
    before, after = buffers(), buffers()
    after["diffuse_red"][:16, 48:] = 1 - after["diffuse_red"][:16, 48:]
    oracle = CnnOracle(net)
    one, other = (oracle.quality(frame(c), 60.0) for c in (before, after))
    moved = np.abs(np.asarray(other - one)).max(axis=1).reshape(3, 4)
    assert moved[0, 3] > 1e-4
    # Each layer reaches a pixel further, of 1, 1, 2, 4 and 8 px: to the next tile.
    assert np.all(moved[2:] == 0) and np.all(moved[:, :2] == 0)


def test_two_outputs_are_extrapolated():
    net = network(outputs=("2x1", "1x2"))
    channels = buffers()
    quality = CnnOracle(net).quality(frame(channels), 60.0)
    np.testing.assert_allclose(
        quality, -expected_errors(net, channels), rtol=0, atol=ATOL
    )


def test_smaller_regions_give_their_largest_error():
    net = network(region=8, groups=(1, 1, 1, 1))
    channels = buffers()
    quality = CnnOracle(net).quality(frame(channels), 60.0)
    of_region = np.asarray(predicted(net, stacked(net, channels), True))
    assert of_region.shape == (4, 5, 8)
    whole = np.pad(of_region, ((0, 0), (0, 1), (0, 0)), mode="edge")
    largest = whole.reshape(4, 3, 2, 4, 2).max(axis=(2, 4)).reshape(4, -1)
    for name, errors in zip(net.outputs, largest, strict=True):
        found = quality[:, RATES.names.index(name)]
        np.testing.assert_allclose(found, -errors, rtol=0, atol=ATOL)


def test_psnr_is_taken_as_an_error():
    transform = ClampedTransform(-0.015, 1.0)
    net = network(metric="psnr", transform=transform)
    oracle = CnnOracle(net)
    channels = buffers()
    psnr = np.asarray(predicted(net, stacked(net, channels), True)).reshape(4, -1)
    error = 10 ** (-psnr / 20)
    assert oracle.unit == "RMSE"
    quality = oracle.quality(frame(channels), 60.0)
    at = [RATES.names.index(name) for name in net.outputs]
    np.testing.assert_allclose(quality[:, at], -error.T, rtol=0, atol=ATOL)


def test_threshold(net):
    channels = buffers()
    oracle = CnnOracle(net)
    errors = expected_errors(net, channels)
    threshold = float(np.median(errors[:, :-1]))
    below = errors < threshold
    below[:, -1] = True
    chosen = np.asarray(oracle.rate(frame(channels), 60.0, threshold=threshold))
    np.testing.assert_array_equal(chosen, below.argmax(axis=1))
    assert len(set(chosen.tolist())) > 1
    nothing = oracle.rate(frame(channels), 60.0, threshold=0.0)
    assert np.all(np.asarray(nothing) == len(RATES) - 1)


def test_neither_refresh_rate_nor_velocity_counts(net):
    oracle = CnnOracle(net)
    still = oracle.quality(frame(buffers()), 60.0)
    moving = oracle.quality(frame(buffers(), velocity=30.0), 144.0)
    np.testing.assert_array_equal(still, moving)


@pytest.mark.parametrize("backend", ["jax", "onnxruntime"])
def test_jit_and_vmap(net, backend):
    oracle = CnnOracle(net, backend=backend)
    frames = [frame(buffers(seed)) for seed in range(2)]
    plain = jnp.stack([oracle.quality(f, 60.0) for f in frames])
    stack = jax.tree.map(lambda *x: jnp.stack(x), *frames)
    mapped = eqx.filter_jit(jax.vmap(lambda f: oracle.quality(f, 60.0)))(stack)
    np.testing.assert_allclose(mapped, plain, rtol=0, atol=ATOL)
    rates = jax.vmap(lambda r: oracle.quality(frames[0], r))(jnp.array([30.0, 90.0]))
    np.testing.assert_allclose(rates, jnp.stack([plain[0]] * 2), rtol=0, atol=ATOL)


def test_gradient_reaches_the_buffers(net):
    small = frame(buffers(0, 16, 16), 16, 16)
    oracle, where = CnnOracle(net), lambda f: f.channels["diffuse_red"]

    def total(red):
        return jnp.sum(oracle.quality(eqx.tree_at(where, small, red), 60.0))

    slope = jax.jit(jax.grad(total))(where(small))
    assert np.all(np.isfinite(slope)) and float(abs(slope).max()) > 0


def test_one_compilation_serves_frames_and_weights(net):
    call = eqx.filter_jit(
        eqx.debug.assert_max_traces(_quality.__wrapped__, max_traces=1)
    )
    where = lambda n: n.safety_offset
    for seed in range(3):
        oracle = CnnOracle(eqx.tree_at(where, net, jnp.float32(seed / 10)))
        channels = buffers(seed)
        inputs = tuple(jnp.asarray(channels[n]) for n in net.channels)
        call(oracle, inputs, jnp.zeros(()))


def test_missing_buffers_are_named(net):
    oracle = CnnOracle(net)
    with pytest.raises(ValueError, match="lacks reprojected_red, seen, diffuse_red"):
        oracle.quality(frame(None), 60.0)
    channels = buffers()
    del channels["normal_z"]
    with pytest.raises(ValueError, match="but lacks normal_z"):
        oracle.quality(frame(channels), 60.0)


def test_buffers_of_different_sizes_are_refused(net):
    channels = buffers() | {"seen": np.ones((HEIGHT - 1, WIDTH))}
    with pytest.raises(ValueError, match=r"one height and width, got \[\(39, 64\)"):
        CnnOracle(net).quality(frame(channels), 60.0)


def test_what_does_not_fit_is_refused(net):
    with pytest.raises(ValueError, match="divide a tile of 16 px, got 32 px"):
        CnnOracle(network(region=32))
    with pytest.raises(ValueError, match="predict 1x2 and 2x1, got 1x2, 2x2"):
        CnnOracle(network(outputs=("1x2", "2x2")))
    with pytest.raises(ValueError, match="`threads` must be None"):
        CnnOracle(net, threads=2)
    with pytest.raises(ValueError, match="`refresh_rate` must be > 0 Hz"):
        CnnOracle(net).quality(frame(buffers()), 0.0)
    with pytest.raises(ValueError, match="`threshold` must be >= 0"):
        CnnOracle(net).rate(frame(buffers()), 60.0, threshold=-1.0)

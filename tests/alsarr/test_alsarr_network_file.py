import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr.network import (
    ClampedTransform,
    initial_network,
    load_network,
    LogisticTransform,
    save_network,
)


def _network(transform=None, **choices):
    return initial_network(
        *(5,),
        metric="flip",
        ppd=60.0,
        transform=transform or ClampedTransform(-0.015, 1.0),
        **choices,
    )


@pytest.fixture
def stored(tmp_path):
    path = tmp_path / "network.npz"
    save_network(path, _network())
    return path


def _rewritten(path, change):
    with np.load(path) as file:
        parts = dict(file)
    header = json.loads(str(parts.pop("header")))
    change(header, parts)
    np.savez(path, header=np.array(json.dumps(header)), **parts)


@pytest.mark.parametrize(
    "transform", [ClampedTransform(1 / 3, 0.1), LogisticTransform(0.3, 7.0)]
)
@pytest.mark.parametrize("groups", [(1, 1, 2, 4, 1), (1, 1, 2, 4, 8, 1)])
def test_a_network_comes_back_to_the_bit(tmp_path, transform, groups):
    network = _network(transform, groups=groups, outputs=("2x1", "1x2"))
    network = eqx.tree_at(lambda n: n.safety_offset, network, jnp.float32(0.06))
    path = tmp_path / "folder" / "network.npz"
    save_network(path, network)
    back = load_network(path)
    assert jax.tree.structure(back) == jax.tree.structure(network)
    for a, b in zip(jax.tree.leaves(back), jax.tree.leaves(network), strict=True):
        np.testing.assert_array_equal(a, b)
        assert a.dtype == b.dtype
    assert [p.name for p in path.parent.iterdir()] == ["network.npz"]


def test_weights_that_are_not_finite_are_not_written(tmp_path):
    network = _network()
    broken = eqx.tree_at(
        lambda n: n.blocks[1].bias, network, jnp.full(16, jnp.nan, jnp.float32)
    )
    with pytest.raises(ValueError, match="`network` must have weights that are finite"):
        save_network(tmp_path / "network.npz", broken)
    with pytest.raises(ValueError, match="`path` must end in .npz, got "):
        save_network(tmp_path / "network.onnx", network)
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_cut_off_or_altered_is_refused(stored):
    whole = stored.read_bytes()
    with pytest.raises(FileNotFoundError):
        load_network(stored.with_name("other.npz"))
    for damaged in (whole[: len(whole) // 2], b"", b"PK", whole[:-30]):
        stored.write_bytes(damaged)
        with pytest.raises(ValueError, match=f"^{stored}: (is no NPZ|was altered)"):
            load_network(stored)
    # A bit of the weights: the archive's own checksum tells.
    middle = len(whole) // 2
    stored.write_bytes(
        whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]
    )
    with pytest.raises(ValueError, match=f"^{stored}: was altered or cut off"):
        load_network(stored)


def _set(name, value):
    return lambda header, parts: header.__setitem__(name, value)


@pytest.mark.parametrize(
    "change, message",
    [
        (_set("schema", "other/1"), "schema must be 'alsarr-network/1', got 'other/1'"),
        (_set("channels", ["seen"]), r"`blocks\[0\]` must have 1 input channels"),
        (_set("outputs", ["1x1"]), "`outputs` must be some of"),
        (_set("layers", [{"groups": 3, "pool": 1}]), "`groups` must divide"),
        (_set("layers", [{"groups": 1, "pool": 0}]), "`pool` must be > 0 px"),
        (_set("layers", [{"groups": 1}]), "lacks or has another kind of 'pool'"),
        (_set("layers", []), "should not have weight_0"),
        (_set("layers", 3), "lacks or has another kind of"),
        (_set("transform", {"kind": "cubic"}), "another kind of 'cubic'"),
        (_set("transform", {"kind": "clamped"}), "another kind of 'factor'"),
        (
            _set("transform", {"kind": "clamped", "factor": 0, "offset": 0}),
            "`factor` must be finite and not 0",
        ),
        (lambda h, p: h.pop("metric"), "another kind of 'metric'"),
        (lambda h, p: p.pop("mean_2"), "another kind of 'mean_2'"),
        (lambda h, p: p.update(more=np.zeros(1, np.float32)), "should not have more"),
        (lambda h, p: p.update(bias_0=np.zeros(3, np.float32)), "`bias_0` must have"),
        (lambda h, p: p.update(weight_0=p["weight_0"][0]), "`weight_0` must be 3x3"),
        (lambda h, p: p.update(variance_1=-p["variance_1"]), "`variance_1` must be >="),
        (lambda h, p: p.update(bias_0=p["bias_0"] * np.nan), "`bias_0` must be finite"),
        (lambda h, p: p.update(bias_0=np.zeros(16)), "`bias_0` must be finite float32"),
        (
            lambda h, p: p.update(safety_offset=np.zeros(2, np.float32)),
            "should not have several offsets",
        ),
    ],
)
def test_a_file_of_another_kind_is_refused(stored, change, message):
    _rewritten(stored, change)
    with pytest.raises(ValueError, match=f"^{stored}: .*{message}"):
        load_network(stored)


def test_nothing_in_a_file_is_executed(stored):
    with np.load(stored) as file:
        parts = dict(file)
    parts["bias_0"] = np.array([print], object)
    with stored.open("wb") as file:
        np.savez(file, allow_pickle=True, **parts)
    with pytest.raises(ValueError, match="was altered or cut off: .*pickle"):
        load_network(stored)

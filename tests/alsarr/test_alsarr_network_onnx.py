"""Graphs that are written, read and refused, and onnxruntime as judge."""

import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import onnx
import onnxruntime
import pytest

from alsarr.network import ClampedTransform, initial_network, LogisticTransform
from alsarr.network._fast import infer
from alsarr.network._onnx_export import export_onnx, onnx_bytes
from alsarr.network._onnx_import import import_onnx
from alsarr.network._onnx_run import OnnxNetwork


ATOL = 1e-5
KNOWN = {
    "channels": ("reprojected_red", "seen", "diffuse_red", "normal_z"),
    "outputs": ("2x2",),
    "metric": "flip",
    "ppd": 60.0,
    "transform": ClampedTransform(2.0),
}
TWO = {
    "channels": ("diffuse_red", "specular_red", "normal_z", "shadow"),
    "outputs": ("1x2", "2x1"),
    "metric": "flip",
    "ppd": 60.0,
    "transform": LogisticTransform(0.1),
}


@eqx.filter_jit
def called(net, x):
    """Compiled as a whole, which takes less than one operation after the other."""
    return net(jnp.asarray(x))


@eqx.filter_jit
def predicted(net, x, safe):
    return net.predict(x, safe=safe)


def trained(**settings):
    """With statistics and gains as if it were."""
    net = initial_network(
        5, metric="flip", ppd=60.0, transform=ClampedTransform(2.0), **settings
    )
    draw = np.random.default_rng(0)
    blocks = []
    for block in net.blocks:
        n = block.bias.shape[0]
        values = [draw.uniform(*ends, n) for ends in ((-2, 2), (-1, 1), (0, 1))]
        values.append(draw.uniform(0.05, 1, n))
        where = lambda b: (b.scale, b.shift, b.mean, b.variance)
        new = [jnp.asarray(v, jnp.float32) for v in values]
        blocks.append(eqx.tree_at(where, block, new))
    net = eqx.tree_at(lambda n: n.blocks, net, tuple(blocks))
    return eqx.tree_at(lambda n: n.safety_offset, net, jnp.float32(0.05))


def picture(height, width, seed=0):
    """Masked, as a graph wants it and a network does not mind."""
    x = np.random.default_rng(seed).uniform(-1, 1, (4, height, width))
    x[1] = x[1] > -0.3
    x[0] *= x[1]
    return x.astype(np.float32)


def run(model, x):
    data = model if isinstance(model, bytes) else model.SerializeToString()
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    return session.run(None, {"input": x[None]})[0][0]


def released(groups, pools, outs, *, height=32, width=48, seed=0):
    """A graph such as PyTorch 1.7 wrote: opset 9, numbered names, fixed sizes."""
    draw = np.random.default_rng(seed)
    nodes, weights, values, number = [], {}, "input", 40
    counts = [4, *[16] * (len(groups) - 1), outs]
    for i, (group, pool) in enumerate(zip(groups, pools, strict=True)):
        ins, out = counts[i] // group, counts[i + 1]
        conv, norm = f"layers.{3 * i}", f"layers.{3 * i + 2}"
        weights |= {
            f"{conv}.weight": draw.normal(0, (9 * ins) ** -0.5, (out, ins, 3, 3)),
            f"{conv}.bias": draw.normal(0, 0.1, out),
            f"{norm}.weight": draw.uniform(-1.5, 1.5, out),
            f"{norm}.bias": draw.normal(0, 0.5, out),
            f"{norm}.running_mean": draw.uniform(0, 0.5, out),
            f"{norm}.running_var": draw.uniform(0.05, 1, out),
        }
        first, second, third, fourth = (str(number + k) for k in range(4))
        number += 4
        nodes += [
            onnx.helper.make_node(
                "Conv",
                [values, f"{conv}.weight", f"{conv}.bias"],
                [first],
                name=f"Conv_{number}",
                dilations=[1, 1],
                group=group,
                kernel_shape=[3, 3],
                pads=[1, 1, 1, 1],
                strides=[1, 1],
            ),
            onnx.helper.make_node("Relu", [first], [second]),
            onnx.helper.make_node(
                "BatchNormalization",
                [second, *[f"{norm}.{k}" for k in ("weight", "bias")]]
                + [f"{norm}.running_mean", f"{norm}.running_var"],
                [third],
                epsilon=1e-5,
                momentum=0.9,
            ),
        ]
        values = third
        if pool > 1:
            nodes.append(
                onnx.helper.make_node(
                    "MaxPool",
                    [third],
                    [fourth],
                    kernel_shape=[pool, pool],
                    pads=[0, 0, 0, 0],
                    strides=[pool, pool],
                )
            )
            values = fourth
    nodes.append(onnx.helper.make_node("Sigmoid", [values], ["metric"]))
    return assembled(nodes, weights, (4, height, width), outs, np.prod(pools))


def assembled(nodes, weights, size, outs, region, opset=9):
    channels, height, width = size
    kind = onnx.TensorProto.FLOAT
    info = onnx.helper.make_tensor_value_info
    tensors = [
        onnx.numpy_helper.from_array(np.asarray(v, np.float32), name)
        for name, v in weights.items()
    ]
    # As opset 9 has it: weights are inputs too.
    inputs = [info("input", kind, [1, channels, height, width])]
    inputs += [info(t.name, kind, list(t.dims)) for t in tensors]
    shape = [1, outs, int(height // region), int(width // region)]
    graph = onnx.helper.make_graph(
        nodes, "torch-jit-export", inputs, [info("metric", kind, shape)], tensors
    )
    opsets = [onnx.helper.make_opsetid("", opset)]
    return onnx.helper.make_model(graph, opset_imports=opsets, ir_version=6)


def small():
    return released((1, 2, 1), (1, 2, 2), 1)


def saved(model, folder):
    path = folder / "graph.onnx"
    path.write_bytes(model.SerializeToString())
    return path


def attribute(model, operator, name, value):
    """Set an attribute of the first operator of a kind."""
    node = next(n for n in model.graph.node if n.op_type == operator)
    kept = [a for a in node.attribute if a.name != name]
    del node.attribute[:]
    node.attribute.extend([*kept, onnx.helper.make_attribute(name, value)])
    return model


@pytest.fixture(scope="module")
def net():
    return trained()


# Writing


@pytest.mark.parametrize("size", [(32, 48), (16, 64)])
def test_written_graph_gives_what_the_network_gives(net, size):
    x = picture(*size)
    expected = np.asarray(called(net, x))
    assert np.ptp(expected) > 1e-3
    np.testing.assert_allclose(run(onnx_bytes(net), x), expected, rtol=0, atol=ATOL)


@pytest.mark.parametrize(
    "settings",
    [
        {"groups": (1, 2, 8, 1), "region": 8, "outputs": ("1x2", "2x1")},
        {"groups": (2, 1, 1), "region": 6, "latent": 8},
    ],
)
def test_written_graphs_of_other_layers(settings):
    net = trained(**settings)
    x = picture(48, 48)
    expected = np.asarray(infer(net, jnp.asarray(x)))
    np.testing.assert_allclose(run(onnx_bytes(net), x), expected, rtol=0, atol=ATOL)


def test_written_file_is_valid_and_says_what_it_is(net, tmp_path):
    path = tmp_path / "net.onnx"
    export_onnx(path, net)
    assert [p.name for p in tmp_path.iterdir()] == ["net.onnx"]
    model = onnx.load(path)
    onnx.checker.check_model(model, full_check=True)
    assert model.opset_import[0].version >= 17
    operators = {n.op_type for n in model.graph.node}
    assert operators == {"Conv", "Relu", "BatchNormalization", "MaxPool", "Sigmoid"}
    groups = [
        onnx.helper.get_node_attr_value(n, "group")
        for n in model.graph.node
        if n.op_type == "Conv"
    ]
    assert groups == [1, 1, 2, 4, 1]
    (entry,) = model.graph.input
    sides = [d.dim_param or d.dim_value for d in entry.type.tensor_type.shape.dim]
    assert (entry.name, sides) == ("input", ["batch", 4, "height", "width"])
    assert model.graph.output[0].name == "metric"
    for name in (*net.channels, *net.outputs, "flip", "16 x 16 px"):
        assert name in model.doc_string


def test_what_cannot_be_written_leaves_the_file_alone(net, tmp_path):
    path = tmp_path / "net.onnx"
    path.write_text("mine")
    where = lambda n: n.blocks[1].bias
    bad = eqx.tree_at(where, net, where(net).at[3].set(jnp.inf))
    with pytest.raises(ValueError, match="finite in float32"):
        export_onnx(path, bad)
    assert path.read_text() == "mine"
    with pytest.raises(ValueError, match=r"must end in \.onnx, got .*net\.npz"):
        export_onnx(tmp_path / "net.npz", net)


# Reading


@pytest.mark.parametrize(
    ("groups", "pools", "outs", "known"),
    [
        ((1, 1, 2, 4, 1), (1, 2, 2, 2, 1), 1, KNOWN),
        ((1, 1, 2, 4, 8, 1), (1, 2, 2, 2, 2, 1), 2, TWO),
    ],
)
def test_released_graphs_give_what_onnxruntime_gives(
    groups, pools, outs, known, tmp_path
):
    model = released(groups, pools, outs)
    net = import_onnx(saved(model, tmp_path), **known)
    assert net.region == np.prod(pools)
    assert (net.channels, net.outputs) == (known["channels"], known["outputs"])
    assert float(net.safety_offset) == 0
    x = picture(32, 48)
    expected = run(model, x)
    assert np.ptp(expected) > 1e-3
    np.testing.assert_allclose(called(net, x), expected, rtol=0, atol=ATOL)


def test_what_was_written_is_read_to_the_bit(net, tmp_path):
    path = tmp_path / "net.onnx"
    export_onnx(path, net)
    known = {
        k: getattr(net, k)
        for k in ("channels", "outputs", "metric", "ppd", "transform")
    }
    again = import_onnx(path, **known)
    assert again.blocks[2].groups == 2 and again.blocks[2].pool == 2
    for one, other in zip(
        jax.tree.leaves(net.blocks), jax.tree.leaves(again.blocks), strict=True
    ):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


def test_convolution_without_bias(tmp_path):
    model = small()
    for node in model.graph.node:
        if node.op_type == "Conv":
            del node.input[2]
    net = import_onnx(saved(model, tmp_path), **KNOWN)
    x = picture(32, 48)
    np.testing.assert_allclose(called(net, x), run(model, x), rtol=0, atol=ATOL)


@pytest.mark.parametrize(
    ("operator", "name", "value", "words"),
    [
        ("Conv", "dilations", [2, 2], r"dilations of Conv 'Conv_44' must be \[1, 1\]"),
        ("Conv", "strides", [2, 2], "strides of Conv"),
        ("Conv", "pads", [0, 0, 1, 1], r"pads of Conv .* got \[0, 0, 1, 1\]"),
        ("Conv", "auto_pad", "SAME_UPPER", "auto_pad of Conv"),
        ("Conv", "kernel_shape", [1, 1], "kernel_shape of Conv"),
        ("Conv", "group", 3, "`groups` must divide"),
        ("Conv", "group", 2, "must have 4 input channels, got 8"),
        ("Conv", "group", "two", "has an attribute of another kind"),
        ("Conv", "odd", 1, "attribute odd of Conv 'Conv_44' is not supported"),
        ("Relu", "odd", 1, "attribute odd of Relu is not supported"),
        ("BatchNormalization", "epsilon", 1e-3, "epsilon of BatchNormalization"),
        ("BatchNormalization", "training_mode", 1, "training_mode of Batch"),
        ("MaxPool", "ceil_mode", 1, "ceil_mode of MaxPool"),
        ("MaxPool", "dilations", [2, 2], "dilations of MaxPool"),
        ("MaxPool", "pads", [1, 1, 0, 0], "pads of MaxPool"),
        ("MaxPool", "strides", [1, 1], r"strides of MaxPool must be .* \[2, 2\]"),
        ("MaxPool", "kernel_shape", [2, 3], "kernel_shape of MaxPool must be square"),
    ],
)
def test_attributes_of_other_graphs_are_refused(operator, name, value, words, tmp_path):
    model = attribute(small(), operator, name, value)
    with pytest.raises(ValueError, match=words) as caught:
        import_onnx(saved(model, tmp_path), **KNOWN)
    assert str(caught.value).startswith(str(tmp_path / "graph.onnx"))


def pads_are_not_given(model):
    node = model.graph.node[0]
    kept = [a for a in node.attribute if a.name != "pads"]
    del node.attribute[:]
    node.attribute.extend(kept)


def another_operator(model):
    model.graph.node[1].op_type = "LeakyRelu"


def another_domain(model):
    model.graph.node[1].domain = "com.example"


def another_order(model):
    nodes = model.graph.node
    nodes[1].op_type, nodes[2].op_type = "BatchNormalization", "Relu"


def a_branch(model):
    model.graph.node[4].input[0] = model.graph.node[0].output[0]


def no_end(model):
    del model.graph.node[-1]
    model.graph.output[0].name = model.graph.node[-1].output[0]


def two_outputs(model):
    model.graph.output.append(model.graph.output[0])


def nothing(model):
    del model.graph.node[:]


def a_missing_weight(model):
    model.graph.node[0].input[1] = "nowhere"


def half_precision(model):
    tensor = model.graph.initializer[0]
    values = onnx.numpy_helper.to_array(tensor).astype(np.float16)
    tensor.CopyFrom(onnx.numpy_helper.from_array(values, tensor.name))


def not_a_number(model):
    tensor = model.graph.initializer[0]
    values = onnx.numpy_helper.to_array(tensor) * np.float32(np.nan)
    tensor.CopyFrom(onnx.numpy_helper.from_array(values, tensor.name))


def weights_elsewhere(model):
    tensor = model.graph.initializer[0]
    tensor.data_location = onnx.TensorProto.EXTERNAL


def a_large_kernel(model):
    tensor = model.graph.initializer[0]
    values = np.zeros((16, 4, 5, 5), np.float32)
    tensor.CopyFrom(onnx.numpy_helper.from_array(values, tensor.name))


def a_short_bias(model):
    tensor = model.graph.initializer[1]
    values = np.zeros(3, np.float32)
    tensor.CopyFrom(onnx.numpy_helper.from_array(values, tensor.name))


def a_negative_variance(model):
    tensor = model.graph.initializer[5]
    values = -onnx.numpy_helper.to_array(tensor)
    tensor.CopyFrom(onnx.numpy_helper.from_array(values, tensor.name))


def an_old_opset(model):
    model.opset_import[0].version = 7


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (pads_are_not_given, "attribute pads of Conv"),
        (another_operator, "operator LeakyRelu is not supported, only Conv"),
        (another_domain, "operator Relu is not supported"),
        (another_order, "operator BatchNormalization must not come after Conv"),
        (a_branch, "must take what the one before it gives"),
        (no_end, "must end in a Sigmoid that gives the output, got MaxPool"),
        (two_outputs, "one input and one output, got 1 and 2"),
        (nothing, "graph with operators"),
        (a_missing_weight, "weight nowhere must be an initializer"),
        (half_precision, "must be float32, got FLOAT16"),
        (not_a_number, "weight layers.0.weight must be finite"),
        (weights_elsewhere, "must be inside the file"),
        (a_large_kernel, "must be 3x3 kernels"),
        (a_short_bias, r"must have 16 numbers of each kind, got shape \(3,\)"),
        (a_negative_variance, "variance of BatchNormalization must be >= 0"),
        (an_old_opset, "opset must be 9 or later, got 7"),
    ],
)
def test_other_graphs_are_refused_by_name(damage, words, tmp_path):
    model = small()
    damage(model)
    with pytest.raises(ValueError, match=words):
        import_onnx(saved(model, tmp_path), **KNOWN)


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "graph.onnx"
    path.write_bytes(small().SerializeToString()[:-100])
    with pytest.raises(ValueError, match="no ONNX file, or was cut off"):
        import_onnx(path, **KNOWN)
    path.write_bytes(b"")
    with pytest.raises(ValueError, match="graph with operators"):
        import_onnx(path, **KNOWN)
    with pytest.raises(FileNotFoundError):
        import_onnx(tmp_path / "none.onnx", **KNOWN)


def test_names_must_fit_the_graph(tmp_path):
    path = saved(small(), tmp_path)
    with pytest.raises(ValueError, match="one for each of `outputs`, got 1"):
        import_onnx(path, **(KNOWN | {"outputs": ("1x2", "2x1")}))
    with pytest.raises(ValueError, match="must have 3 input channels, got 4"):
        import_onnx(path, **(KNOWN | {"channels": ("seen", "shadow", "normal_z")}))


# Running


def test_onnxruntime_as_a_network(net):
    other = OnnxNetwork(net, threads=1)
    # Sizes that are no multiples, and unseen parts that are not masked yet.
    x = jnp.asarray(picture(33, 50)).at[0].set(0.7)
    np.testing.assert_allclose(other(x), infer(net, x), rtol=0, atol=ATOL)
    np.testing.assert_allclose(jax.jit(other)(x), infer(net, x), rtol=0, atol=ATOL)
    for safe in (True, False):
        expected = predicted(net, x, safe)
        np.testing.assert_allclose(
            other.predict(x, safe=safe), expected, rtol=0, atol=ATOL
        )


def test_onnxruntime_takes_many_pictures_at_once(net):
    other = OnnxNetwork(net, threads=1)
    several = jnp.stack([jnp.asarray(picture(16, 32, seed)) for seed in range(3)])
    expected = np.stack([run(onnx_bytes(net), np.asarray(x)) for x in several])
    found = jax.jit(jax.vmap(other))(several)
    np.testing.assert_allclose(found, expected, rtol=0, atol=ATOL)
    again = jax.vmap(jax.vmap(other))(several[:, None])
    np.testing.assert_allclose(again[:, 0], expected, rtol=0, atol=ATOL)


def test_threads_are_counted_from_one(net):
    with pytest.raises(ValueError, match="`threads` must be > 0, got 0"):
        OnnxNetwork(net, threads=0)


@pytest.mark.parametrize("name", ["onnx", "onnxruntime"])
def test_missing_extra_is_named(name, net, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(
        ImportError, match=rf"`alsarr\[onnx\]` is not .* needs its {name}\."
    ):
        OnnxNetwork(net)
    if name == "onnx":
        with pytest.raises(ImportError, match=r"`alsarr\[onnx\]` is not installed"):
            export_onnx(tmp_path / "net.onnx", net)
        with pytest.raises(ImportError, match=r"`alsarr\[onnx\]` is not installed"):
            import_onnx(tmp_path / "net.onnx", **KNOWN)

"""Networks as ONNX graphs, for engines and other libraries."""

from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from camojab._extras import needed
from camojab._files import replacing

from ._model import ConvolutionBlock, EPSILON, MetricNetwork


INPUT, OUTPUT = "input", "metric"

OPSET = 17
"""Version of the operators that are written."""

# That came with these operators; later ones are refused by older libraries.
_IR_VERSION = 8


def export_onnx(path: str | Path, network: MetricNetwork) -> None:
    """Write a network as an ONNX graph.

    The graph maps `input`, [batch, channels, height, width] in float32, to `metric`,
    [batch, outputs, rows, columns]: the transformed metric, as a call of the network.
    Batch, height and width are free. Its operators are those of the released graphs:
    Conv with its groups, Relu, BatchNormalization, MaxPool and Sigmoid. The names of
    channels and outputs are in its `doc_string`. It lacks what those lack too, which is
    the renderer's to do:

    - What was reprojected is 0 where it was not seen.
    - Sizes are multiples of the region: MaxPool drops what is left over, where
        `pad_to_regions` has the last row and column repeated.
    - The safety offset and the inverse transform come afterwards.

    The file is written whole or not at all.

    **Raises:** `ValueError` for another ending than .onnx, or a weight that is not
    finite in float32; `ImportError` without the extra `onnx`.
    """
    if Path(path).suffix.lower() != ".onnx":
        raise ValueError(f"`path` must end in .onnx, got {path}.")
    data = onnx_bytes(network)
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def onnx_bytes(network: MetricNetwork) -> bytes:
    """The file that `export_onnx` writes."""
    onnx = needed("onnx", "onnx", "writing ONNX graphs")
    tensors, nodes = {}, []
    values = INPUT
    for i, block in enumerate(network.blocks):
        tensors |= _tensors(i, block)
        added, values = _nodes(onnx, i, block, values)
        nodes += added
    if not all(np.isfinite(array).all() for array in tensors.values()):
        raise ValueError("`network` must have weights that are finite in float32.")
    nodes.append(onnx.helper.make_node("Sigmoid", [values], [OUTPUT], name="sigmoid"))
    sizes = {
        INPUT: ["batch", len(network.channels), "height", "width"],
        OUTPUT: ["batch", len(network.outputs), "rows", "columns"],
    }
    ends = {
        name: onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, shape)
        for name, shape in sizes.items()
    }
    graph = onnx.helper.make_graph(
        nodes,
        "metric_network",
        [ends[INPUT]],
        [ends[OUTPUT]],
        [onnx.numpy_helper.from_array(array, name) for name, array in tensors.items()],
    )
    model = onnx.helper.make_model(
        graph,
        opset_imports=[onnx.helper.make_opsetid("", OPSET)],
        producer_name="alsarr",
        producer_version=version("alsarr"),
        ir_version=_IR_VERSION,
        doc_string=_described(network),
    )
    return model.SerializeToString()


def _described(network: MetricNetwork) -> str:
    channels, outputs = ", ".join(network.channels), ", ".join(network.outputs)
    return (
        f"{network.metric}, transformed, of {network.region} x {network.region} px; "
        f"{INPUT}: {channels}; {OUTPUT}: {outputs}"
    )


def _tensors(i: int, block: ConvolutionBlock) -> dict[str, np.ndarray]:
    parts = ("weight", "bias", "scale", "shift", "mean", "variance")
    return {f"{part}_{i}": np.asarray(getattr(block, part), "f4") for part in parts}


def _nodes(
    onnx: Any, i: int, block: ConvolutionBlock, values: str
) -> tuple[list[Any], str]:
    """One layer, and the name of what it makes of `values`."""
    node = onnx.helper.make_node
    convolution = node(
        "Conv",
        [values, f"weight_{i}", f"bias_{i}"],
        [f"mixed_{i}"],
        name=f"convolution_{i}",
        kernel_shape=[3, 3],
        pads=[1, 1, 1, 1],
        group=block.groups,
    )
    rectifier = node("Relu", [f"mixed_{i}"], [f"rectified_{i}"], name=f"rectifier_{i}")
    statistics = [f"{part}_{i}" for part in ("scale", "shift", "mean", "variance")]
    normalisation = node(
        "BatchNormalization",
        [f"rectified_{i}", *statistics],
        [f"normalised_{i}"],
        name=f"normalisation_{i}",
        epsilon=EPSILON,
    )
    nodes = [convolution, rectifier, normalisation]
    if block.pool == 1:
        return nodes, f"normalised_{i}"
    sides = [block.pool, block.pool]
    pooling = node(
        "MaxPool",
        [f"normalised_{i}"],
        [f"pooled_{i}"],
        name=f"pooling_{i}",
        kernel_shape=sides,
        strides=sides,
    )
    return [*nodes, pooling], f"pooled_{i}"

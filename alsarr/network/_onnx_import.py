"""ONNX graphs of the family of Cardoso et al. 2022 as networks."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from camojab._extras import needed

from ._model import ConvolutionBlock, EPSILON, MetricNetwork
from ._transforms import AbstractTransform


# Larger files are not read: they are none of this family.
_MOST_BYTES = 2**28

# Before, the operators had attributes of other meanings.
_OLDEST_OPSET = 9

# What may follow what. Each layer is Conv, Relu, BatchNormalization and, where it
# pools, MaxPool.
_FOLLOWS = {
    None: ("Conv",),
    "Conv": ("Relu",),
    "Relu": ("BatchNormalization",),
    "BatchNormalization": ("MaxPool", "Conv", "Sigmoid"),
    "MaxPool": ("Conv", "Sigmoid"),
    "Sigmoid": (),
}

# The only values that an attribute may have. What is absent has them by definition.
_FIXED = {
    "Conv": {
        "auto_pad": b"NOTSET",
        "dilations": [1, 1],
        "kernel_shape": [3, 3],
        "pads": [1, 1, 1, 1],
        "strides": [1, 1],
    },
    "Relu": {},
    "BatchNormalization": {"training_mode": 0},
    "MaxPool": {
        "auto_pad": b"NOTSET",
        "ceil_mode": 0,
        "dilations": [1, 1],
        "pads": [0, 0, 0, 0],
        "storage_order": 0,
    },
    "Sigmoid": {},
}

# Those that are read, or that count only in training.
_READ = {
    "Conv": ("group",),
    "BatchNormalization": ("epsilon", "momentum"),
    "MaxPool": ("kernel_shape", "strides"),
}


def import_onnx(
    path: str | Path,
    *,
    channels: tuple[str, ...],
    outputs: tuple[str, ...],
    metric: str,
    ppd: float,
    transform: AbstractTransform,
) -> MetricNetwork:
    """Read an ONNX graph of this family, such as the released ones.

    The graph is one chain from its only input to its only output: layers of Conv (3x3,
    padded by 1), Relu, BatchNormalization and, where a layer pools, MaxPool, and a
    Sigmoid at the end. What the file does not know comes as arguments. The sizes that
    it names for its input count nothing: the network takes any.

    **Arguments:**

    - `path`: of the file, with its weights inside.
    - `channels`, `outputs`, `metric`, `ppd`, `transform`: see `MetricNetwork`. The
        released networks for one metric have the default channels; that of two has
        "diffuse_red", "specular_red", "normal_z" and "shadow", and "1x2" and "2x1".

    **Returns:** the network, in float32, without a safety offset.

    **Raises:** `ValueError` naming the file and the operator, attribute or weight that
    is not of this family; `FileNotFoundError` if there is none; `ImportError` without
    the extra `onnx`.

    **Accuracy:** of onnxruntime's results within 1e-5
    (`tests/alsarr/test_alsarr_network_onnx.py`).
    """
    onnx = needed("onnx", "onnx", "reading ONNX graphs")
    path = Path(path)
    if path.stat().st_size > _MOST_BYTES:
        raise ValueError(f"{path}: must have at most {_MOST_BYTES} bytes.")
    try:
        model = _model(onnx, path.read_bytes())
        blocks = _blocks(onnx, model.graph)
        return MetricNetwork(
            blocks=tuple(blocks),
            transform=transform,
            safety_offset=jnp.zeros((), jnp.float32),
            channels=channels,
            outputs=outputs,
            metric=metric,
            ppd=ppd,
        )
    except TypeError as error:
        raise ValueError(f"{path}: has an attribute of another kind.") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _model(onnx: Any, data: bytes) -> Any:
    from google.protobuf.message import DecodeError

    try:
        model = onnx.load_model_from_string(data)
    except DecodeError as error:
        raise ValueError("is no ONNX file, or was cut off.") from error
    if not model.graph.node:
        raise ValueError("must have a graph with operators, got none.")
    opset = {entry.domain: entry.version for entry in model.opset_import}.get("", 0)
    if opset < _OLDEST_OPSET:
        raise ValueError(f"opset must be {_OLDEST_OPSET} or later, got {opset}.")
    return model


def _blocks(onnx: Any, graph: Any) -> list[ConvolutionBlock]:
    weights = {tensor.name: tensor for tensor in graph.initializer}
    array = lambda name: _array(onnx, weights, name)
    blocks, parts = [], {}
    for node in _chain(graph, weights):
        attributes = _attributes(onnx, node)
        if node.op_type in ("Conv", "Sigmoid") and parts:
            blocks.append(ConvolutionBlock(**parts))
            parts = {}
        if node.op_type == "Conv":
            parts = _convolution(node, attributes, array)
        elif node.op_type == "BatchNormalization":
            parts |= _normalisation(node, attributes, array, len(parts["bias"]))
        elif node.op_type == "MaxPool":
            parts["pool"] = _pool(node, attributes)
    return blocks


def _chain(graph: Any, weights: dict[str, Any]) -> Iterator[Any]:
    """The operators from the input to the output, each of which may be where it is."""
    inputs = [value.name for value in graph.input if value.name not in weights]
    outputs = [value.name for value in graph.output]
    if len(inputs) != 1 or len(outputs) != 1:
        raise ValueError(
            f"must have one input and one output, got {len(inputs)} and {len(outputs)}."
        )
    before, values = None, inputs[0]
    for node in graph.node:
        if node.domain not in ("", "ai.onnx") or node.op_type not in _FIXED:
            raise ValueError(
                f"operator {node.op_type} is not supported, only "
                f"{', '.join(_FIXED)} are."
            )
        if node.op_type not in _FOLLOWS[before]:
            raise ValueError(
                f"operator {_name(node)} must not come "
                f"{f'after {before}' if before else 'first'}."
            )
        if not node.input or node.input[0] != values or len(node.output) != 1:
            raise ValueError(
                f"operator {_name(node)} must take what the one before it gives, and "
                "give one result."
            )
        before, values = node.op_type, node.output[0]
        yield node
    if before != "Sigmoid" or values != outputs[0]:
        raise ValueError(f"must end in a Sigmoid that gives the output, got {before}.")


def _attributes(onnx: Any, node: Any) -> dict[str, Any]:
    """Of a node. **Raises:** `ValueError` for one that would change what it does."""
    fixed, read = _FIXED[node.op_type], _READ.get(node.op_type, ())
    found = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
    for name, value in found.items():
        value = list(value) if isinstance(value, list | tuple) else value
        if name in fixed and value != fixed[name]:
            raise ValueError(
                f"attribute {name} of {_name(node)} must be {fixed[name]}, got {value}."
            )
        if name not in fixed and name not in read:
            raise ValueError(f"attribute {name} of {_name(node)} is not supported.")
    if node.op_type == "Conv" and "pads" not in found:
        raise ValueError(f"attribute pads of {_name(node)} must be [1, 1, 1, 1].")
    return found


def _convolution(node: Any, attributes: dict[str, Any], array: Any) -> dict[str, Any]:
    names = list(node.input)[1:]
    if len(names) not in (1, 2):
        raise ValueError(f"{_name(node)} must have weights, got {len(names)} inputs.")
    weight = array(names[0])
    if weight.ndim != 4 or weight.shape[2:] != (3, 3) or not weight.size:
        raise ValueError(
            f"weights of {_name(node)} must be 3x3 kernels, got shape {weight.shape}."
        )
    outs = weight.shape[0]
    bias = array(names[1]) if len(names) == 2 and names[1] else np.zeros(outs, "f4")
    _check_vector(node, bias, outs)
    return {
        "weight": jnp.asarray(weight),
        "bias": jnp.asarray(bias),
        "groups": attributes.get("group", 1),
        "pool": 1,
    }


def _normalisation(
    node: Any, attributes: dict[str, Any], array: Any, outs: int
) -> dict[str, Any]:
    names = list(node.input)[1:]
    epsilon = attributes.get("epsilon", EPSILON)
    if not np.isclose(epsilon, EPSILON, rtol=1e-6, atol=0):
        raise ValueError(
            f"attribute epsilon of {_name(node)} must be {EPSILON}, got {epsilon:.4g}."
        )
    if len(names) != 4:
        raise ValueError(
            f"{_name(node)} must have scale, shift, mean and variance, got "
            f"{len(names)} inputs."
        )
    parts = {}
    for part, name in zip(("scale", "shift", "mean", "variance"), names, strict=True):
        values = array(name)
        _check_vector(node, values, outs)
        parts[part] = jnp.asarray(values)
    if bool((parts["variance"] < 0).any()):
        raise ValueError(f"variance of {_name(node)} must be >= 0.")
    return parts


def _pool(node: Any, attributes: dict[str, Any]) -> int:
    sides = list(attributes.get("kernel_shape", []))
    if len(sides) != 2 or sides[0] != sides[1]:
        raise ValueError(
            f"attribute kernel_shape of {_name(node)} must be square, got {sides}."
        )
    strides = list(attributes.get("strides", [1, 1]))
    if strides != sides:
        raise ValueError(
            f"attribute strides of {_name(node)} must be its kernel_shape, {sides}, "
            f"got {strides}."
        )
    return int(sides[0])


def _array(onnx: Any, weights: dict[str, Any], name: str) -> np.ndarray:
    tensor = weights.get(name)
    if tensor is None:
        raise ValueError(f"weight {name} must be an initializer of the graph.")
    if tensor.data_location == onnx.TensorProto.EXTERNAL:
        raise ValueError(f"weight {name} must be inside the file.")
    if tensor.data_type != onnx.TensorProto.FLOAT:
        kind = onnx.TensorProto.DataType.Name(tensor.data_type)
        raise ValueError(f"weight {name} must be float32, got {kind}.")
    array = onnx.numpy_helper.to_array(tensor)
    if not np.isfinite(array).all():
        raise ValueError(f"weight {name} must be finite.")
    return array


def _check_vector(node: Any, values: np.ndarray, count: int) -> None:
    if values.shape != (count,):
        raise ValueError(
            f"{_name(node)} must have {count} numbers of each kind, got shape "
            f"{values.shape}."
        )


def _name(node: Any) -> str:
    return f"{node.op_type} {node.name!r}" if node.name else node.op_type

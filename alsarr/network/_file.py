"""Networks as files."""

import io
import json
import zipfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from camojab._files import DAMAGED, replacing

from ._model import ConvolutionBlock, MetricNetwork
from ._transforms import AbstractTransform, ClampedTransform, LogisticTransform


SCHEMA = "alsarr-network/1"

# Larger files are not read: they are none of ours.
_MOST_BYTES = 2**28

_PARTS = ("weight", "bias", "scale", "shift", "mean", "variance")
_TRANSFORMS = {
    "clamped": (ClampedTransform, ("factor", "offset")),
    "logistic": (LogisticTransform, ("mean", "growth")),
}


def save_network(path: str | Path, network: MetricNetwork) -> None:
    """Write a network as NumPy's archive of float32 arrays with a JSON header.

    The header names the schema, version, metric, channels, outputs, transform, and the
    groups and pooling of each layer. The file is written whole or not at all.

    **Raises:** `ValueError` for another ending than .npz, or a weight that is not
    finite in float32.
    """
    if Path(path).suffix.lower() != ".npz":
        raise ValueError(f"`path` must end in .npz, got {path}.")
    arrays = {
        f"{part}_{i}": np.asarray(getattr(block, part), np.float32)
        for i, block in enumerate(network.blocks)
        for part in _PARTS
    }
    arrays["safety_offset"] = np.asarray(network.safety_offset, np.float32)
    if not all(np.isfinite(array).all() for array in arrays.values()):
        raise ValueError("`network` must have weights that are finite in float32.")
    header = json.dumps(_header(network))
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, header=np.array(header), **arrays)


def load_network(path: str | Path) -> MetricNetwork:
    """Read a network that `save_network` wrote: the same numbers to the bit.

    **Raises:** `ValueError` naming the file and what is wrong with it: no archive, cut
    off, altered, of another schema, or with parts that are missing, not finite or do
    not fit together. `FileNotFoundError` if there is none.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ValueError(f"must have at most {_MOST_BYTES} bytes.")
        header, arrays = read_archive(path, SCHEMA, _MOST_BYTES)
        return _network(header, arrays)
    # What is missing or of another kind is whatever the reader stumbles over.
    except (KeyError, TypeError, IndexError, AttributeError) as error:
        raise ValueError(f"{path}: lacks or has another kind of {error}.") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def read_archive(
    path: Path, schema: str, most_bytes: int
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of an archive whose header has this schema."""
    # From memory, so that a bad offset is no error of the operating system.
    data = io.BytesIO(path.read_bytes())
    if not zipfile.is_zipfile(data):
        raise ValueError("is no NPZ file, or was cut off.")
    try:
        arrays = _unpacked(data, most_bytes)
        header = json.loads(str(arrays.pop("header")))
    except _TooLarge as error:
        raise ValueError(f"must unpack to at most {most_bytes} bytes.") from error
    except DAMAGED as error:
        raise ValueError(f"was altered or cut off: {error}.") from error
    if not isinstance(header, dict) or header.get("schema") != schema:
        found = header.get("schema") if isinstance(header, dict) else header
        raise ValueError(f"schema must be {schema!r}, got {found!r}.")
    return header, arrays


class _TooLarge(Exception):
    """Not a kind of damage."""


def _unpacked(data: io.BytesIO, most_bytes: int) -> dict[str, np.ndarray]:
    with zipfile.ZipFile(data) as archive:
        if sum(member.file_size for member in archive.infolist()) > most_bytes:
            raise _TooLarge
    data.seek(0)
    with np.load(data, allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}


def _header(network: MetricNetwork) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "version": version("alsarr"),
        "metric": network.metric,
        "ppd": network.ppd,
        "channels": list(network.channels),
        "outputs": list(network.outputs),
        "transform": _described(network.transform),
        "layers": [{"groups": b.groups, "pool": b.pool} for b in network.blocks],
    }


def _described(transform: AbstractTransform) -> dict[str, Any]:
    for kind, (its_class, names) in _TRANSFORMS.items():
        if isinstance(transform, its_class):
            numbers = {name: float(getattr(transform, name)) for name in names}
            return {"kind": kind} | numbers
    raise ValueError(
        f"`transform` must be one of {', '.join(_TRANSFORMS)}, got {transform}."
    )


def _network(header: dict[str, Any], arrays: dict[str, np.ndarray]) -> MetricNetwork:
    layers = header["layers"]
    for name, array in arrays.items():
        if array.dtype != np.float32 or not np.isfinite(array).all():
            raise ValueError(f"`{name}` must be finite float32.")
    blocks = []
    for i, layer in enumerate(layers):
        parts = {part: arrays.pop(f"{part}_{i}") for part in _PARTS}
        _check_shapes(i, parts)
        weights = {part: jnp.asarray(array) for part, array in parts.items()}
        groups, pool = int(layer["groups"]), int(layer["pool"])
        blocks.append(ConvolutionBlock(**weights, groups=groups, pool=pool))
    offset = arrays.pop("safety_offset")
    if offset.shape or arrays:
        raise ValueError(f"should not have {', '.join(arrays) or 'several offsets'}.")
    kind = dict(header["transform"])
    its_class, names = _TRANSFORMS[kind.pop("kind")]
    return MetricNetwork(
        blocks=tuple(blocks),
        transform=its_class(*(float(kind[name]) for name in names)),
        safety_offset=jnp.asarray(offset),
        channels=tuple(map(str, header["channels"])),
        outputs=tuple(map(str, header["outputs"])),
        metric=str(header["metric"]),
        ppd=float(header["ppd"]),
    )


def _check_shapes(i: int, parts: dict[str, np.ndarray]) -> None:
    weight = parts["weight"]
    if weight.ndim != 4 or weight.shape[2:] != (3, 3) or not weight.size:
        raise ValueError(f"`weight_{i}` must be 3x3 kernels, got shape {weight.shape}.")
    for part in _PARTS[1:]:
        if parts[part].shape != weight.shape[:1]:
            raise ValueError(
                f"`{part}_{i}` must have shape {weight.shape[:1]}, got "
                f"{parts[part].shape}."
            )
    if (parts["variance"] < 0).any():
        raise ValueError(f"`variance_{i}` must be >= 0.")

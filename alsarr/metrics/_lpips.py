"""Learned perceptual similarity, with weights that the user has."""

from collections.abc import Mapping
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, ArrayLike, Float

from camojab._files import DAMAGED, replacing

from ._checks import checked_pair
from ._colour import total


# Of AlexNet's five convolutions: place in PyTorch's list, channels in and out, kernel,
# stride, padding, and whether pooling comes before.
_LAYERS = (
    (0, 3, 64, 11, 4, 2, False),
    (3, 64, 192, 5, 1, 2, True),
    (6, 192, 384, 3, 1, 1, True),
    (8, 384, 256, 3, 1, 1, False),
    (10, 256, 256, 3, 1, 1, False),
)
# Of pictures in [-1, 1], so that ImageNet has mean 0 and deviation 1.
_SHIFT, _SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)
# The smallest side of which two poolings leave a pixel.
_SMALLEST = 31


class LpipsWeights(eqx.Module, strict=True):
    """Weights of LPIPS 0.1 on AlexNet: its five convolutions and linear layers.

    - `kernels`: of each convolution, [out, in, height, width].
    - `biases`: of each, [out].
    - `linear`: weight of each layer's channels, [out].

    Made by `from_arrays` or `load_lpips_weights`.
    """

    kernels: tuple[Float[Array, "_ _ _ _"], ...]
    biases: tuple[Float[Array, " _"], ...]
    linear: tuple[Float[Array, " _"], ...]

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ArrayLike]) -> "LpipsWeights":
        """Weights by the names that PyTorch gives them.

        **Arguments:** `arrays`: NumPy arrays by name. The convolutions are
        `net.slice1.0`, `net.slice2.3`, `net.slice3.6`, `net.slice4.8` and
        `net.slice5.10`, as in the package lpips, or `features.0`, `.3`, `.6`, `.8` and
        `.10`, as in torchvision's AlexNet, each with `.weight` and `.bias`; the linear
        layers are `lin0.model.1.weight` to `lin4.model.1.weight`. Others are left out.
        Where both packages are installed this makes the file of `load_lpips_weights`:

            state = lpips.LPIPS(net="alex").state_dict()
            arrays = {name: value.numpy() for name, value in state.items()}
            save_lpips_weights(LpipsWeights.from_arrays(arrays), "lpips.npz")

        PyTorch's own files are pickles, which can run any program, and are not read.

        **Raises:** `ValueError` naming what is missing or has another shape.
        """
        kernels, biases, linear = [], [], []
        for layer, (place, into, out, size, *_) in enumerate(_LAYERS):
            names = f"net.slice{layer + 1}.{place}", f"features.{place}"
            kernels.append(_array(arrays, names, ".weight", (out, into, size, size)))
            biases.append(_array(arrays, names, ".bias", (out,)))
            weight = _array(arrays, (f"lin{layer}.model.1",), ".weight", (1, out, 1, 1))
            linear.append(weight[0, :, 0, 0])
        return cls(tuple(kernels), tuple(biases), tuple(linear))


def save_lpips_weights(weights: LpipsWeights, path: str | Path) -> None:
    """Write weights as a NumPy archive, with the names of `LpipsWeights.from_arrays`.

    **Raises:** `OSError` if the file cannot be written.
    """
    arrays = {}
    for layer, (place, *_) in enumerate(_LAYERS):
        name = f"net.slice{layer + 1}.{place}"
        arrays[f"{name}.weight"] = np.asarray(weights.kernels[layer])
        arrays[f"{name}.bias"] = np.asarray(weights.biases[layer])
        linear = np.asarray(weights.linear[layer])[None, :, None, None]
        arrays[f"lin{layer}.model.1.weight"] = linear
    with replacing(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, **arrays)


def load_lpips_weights(path: str | Path) -> LpipsWeights:
    """Read weights from a NumPy archive of arrays named as in `from_arrays`.

    **Raises:** `OSError` for a file that cannot be opened, `ValueError` for one that is
    no such archive.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            return LpipsWeights.from_arrays({name: stored[name] for name in stored})
    except (*DAMAGED, AttributeError, TypeError) as error:
        raise ValueError(
            f"`path` must be an archive of weights, got {path}: {error}"
        ) from error


def lpips(
    reference: ArrayLike,
    test: ArrayLike,
    weights: LpipsWeights,
    *,
    centred: bool = True,
) -> Float[Array, "height width"]:
    """Learned perceptual difference of each pixel.

    **Arguments:**

    - `reference`, `test`: sRGB-encoded, shape [height, width, 3], 31 px or more each
      way. [1], in [0, 1]; integers count from 0 to the largest value of their type.
    - `weights`: see `LpipsWeights`.
    - `centred`: map pictures to [-1, 1], for which the weights were made. Cardoso et
      al. 2022 did not.

    **Returns:** the five layers' differences, each enlarged to the picture by bilinear
    interpolation, added. [1], >= 0 for weights >= 0, as the published ones are.
    Differentiable in pictures and weights.

    **Raises:** `ValueError` for pictures of another shape or of two, or values out of
    range.

    **Accuracy:** within 1e-5 of the package lpips on random weights
    (`tests/alsarr/test_alsarr_metrics_lpips.py`).

    **Source:** Zhang et al. 2018, "The Unreasonable Effectiveness of Deep Features as a
    Perceptual Metric", CVPR, doi:10.1109/CVPR.2018.00068, version 0.1 with AlexNet.
    """
    first, second = _checked(reference, test, centred)
    return _map(first, second, weights)


def lpips_distance(
    reference: ArrayLike,
    test: ArrayLike,
    weights: LpipsWeights,
    *,
    centred: bool = True,
) -> Float[Array, ""]:
    """Learned perceptual difference of two whole pictures.

    **Arguments, raises, source:** as `lpips`.

    **Returns:** the sum of the layers' means, which is what is published as LPIPS. [1].
    The mean of `lpips` comes close to it, but gives edges another weight.
    """
    first, second = _checked(reference, test, centred)
    return _distance(first, second, weights)


def _checked(
    reference: ArrayLike, test: ArrayLike, centred: bool
) -> tuple[Float[Array, "height width 3"], Float[Array, "height width 3"]]:
    """Two pictures in the range that the network is to have."""
    pair = checked_pair(reference, test)
    if min(pair[0].shape[:2]) < _SMALLEST:
        raise ValueError(
            f"`reference` must have {_SMALLEST} x {_SMALLEST} px or more, got "
            f"{pair[0].shape[:2]}."
        )
    return (2 * pair[0] - 1, 2 * pair[1] - 1) if centred else pair


@eqx.filter_jit
def _map(
    first: Float[Array, "height width 3"],
    second: Float[Array, "height width 3"],
    weights: LpipsWeights,
) -> Float[Array, "height width"]:
    size = first.shape[:2]
    layers = _layers(first, second, weights)
    return total(jax.image.resize(x, size, "bilinear", antialias=False) for x in layers)


@eqx.filter_jit
def _distance(
    first: Float[Array, "height width 3"],
    second: Float[Array, "height width 3"],
    weights: LpipsWeights,
) -> Float[Array, ""]:
    return total(jnp.mean(x) for x in _layers(first, second, weights))


def _layers(
    first: Float[Array, "height width 3"],
    second: Float[Array, "height width 3"],
    weights: LpipsWeights,
) -> list[Float[Array, "_ _"]]:
    """Weighted squared differences of the features, at each layer's resolution."""
    pair = jnp.stack([first, second]).transpose(0, 3, 1, 2)
    shift, scale = (jnp.asarray(v, pair.dtype) for v in (_SHIFT, _SCALE))
    features = (pair - shift[None, :, None, None]) / scale[None, :, None, None]
    layers = []
    for layer, (*_, stride, padding, pooled) in enumerate(_LAYERS):
        if pooled:
            features = _pooled(features)
        kernel = weights.kernels[layer].astype(pair.dtype)
        bias = weights.biases[layer].astype(pair.dtype)
        ends = [(padding, padding)] * 2
        # A GPU would otherwise round to ten bits, here and below.
        found = lax.conv_general_dilated(
            features, kernel, (stride, stride), ends, precision="highest"
        )
        features = jax.nn.relu(found + bias[None, :, None, None])
        weight = weights.linear[layer].astype(pair.dtype)
        unit = _normalised(features)
        square = (unit[0] - unit[1]) ** 2
        layers.append(jnp.tensordot(weight, square, axes=1, precision="highest"))
    return layers


def _pooled(features: Float[Array, "2 channels h w"]) -> Float[Array, "2 channels _ _"]:
    window, strides = (1, 1, 3, 3), (1, 1, 2, 2)
    return lax.reduce_window(features, -jnp.inf, lax.max, window, strides, "VALID")


def _normalised(
    features: Float[Array, "2 channels h w"],
) -> Float[Array, "2 channels h w"]:
    """Features of length 1 at each place; none stay none, with derivative 0."""
    square = jnp.sum(features**2, axis=1, keepdims=True)
    zero = square == 0
    length = jnp.where(zero, 0, jnp.sqrt(jnp.where(zero, 1, square)))
    return features / (length + 1e-10)


def _array(
    arrays: Mapping[str, ArrayLike],
    names: tuple[str, ...],
    kind: str,
    shape: tuple[int, ...],
) -> Array:
    wanted = [name + kind for name in names]
    found = [name for name in wanted if name in arrays]
    if not found:
        raise ValueError(f"`arrays` must have {' or '.join(wanted)}, got none.")
    value = jnp.asarray(arrays[found[0]], jnp.result_type(float))
    if value.shape != shape:
        raise ValueError(
            f"`{found[0]}` must have shape {list(shape)}, got {list(value.shape)}."
        )
    return value

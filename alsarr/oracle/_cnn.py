from typing import Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from .._frame import Frame
from .._rates import RATES, TILE
from ..network._choose import choose_mode
from ..network._extrapolate import as_error, extrapolate
from ..network._fast import infer
from ..network._model import in_own_unit, MetricNetwork
from ..network._onnx_run import OnnxNetwork
from ._base import AbstractQualityOracle
from ._checks import checked_refresh_rate


_UNITS = {"flip": "FLIP", "jnflip": "JNFLIP", "psnr": "RMSE", "lpips": "LPIPS"}


class CnnOracle(AbstractQualityOracle, strict=True):
    """A network that predicts a metric of the rendered picture before it is shaded.

    Its quality is minus the predicted error of each tile: 0 at full rate. Rates that
    the network does not predict follow from those that it does (`extrapolate`). What a
    network of smaller regions than tiles predicts for a tile is the largest of its
    regions. A metric that is better when larger, such as PSNR, is taken as an error
    (`as_error`). Neither the refresh rate nor the velocities count: the network judges
    a still picture, and motion is in it only as what could not be reprojected.

    **Arguments:**

    - `network`: predicts 1x2 and 2x1 at least. Its region divides the tile, 16 px.
    - `safe`: with the network's safety offset, against underestimation.
    - `backend`: "jax" (jit, vmap and grad go through it), or "onnxruntime", which is
        faster on a CPU, has no gradient, needs the extra `onnx` and keeps the weights
        that the network has now, so they must be concrete.
    - `threads`: of onnxruntime. > 0; None leaves it the choice.

    **Raises:** `ValueError` naming the argument that does not fit; `ImportError` for
    onnxruntime without the extra `onnx`.

    **Source:** Cardoso et al. 2022, Section 4.
    """

    network: MetricNetwork
    safe: bool = eqx.field(static=True)
    other: OnnxNetwork | None = eqx.field(static=True)

    def __init__(
        self,
        network: MetricNetwork,
        *,
        safe: bool = True,
        backend: Literal["jax", "onnxruntime"] = "jax",
        threads: int | None = None,
    ):
        _check_network(network)
        if backend not in ("jax", "onnxruntime"):
            raise ValueError(f"`backend` must be jax or onnxruntime, got {backend}.")
        if threads is not None and backend == "jax":
            raise ValueError("`threads` must be None for the backend jax.")
        self.network = network
        self.safe = safe
        self.other = None
        if backend == "onnxruntime":
            self.other = OnnxNetwork(network, threads=threads)

    @property
    def unit(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Of the qualities: the metric's name."""
        return _UNITS.get(self.network.metric, self.network.metric)

    def quality(self, frame: Frame, refresh_rate: ArrayLike) -> Float[Array, "tiles 7"]:
        """See `AbstractQualityOracle.quality`. `frame.channels` is needed.

        **Raises:** `ValueError` also for a channel that the network needs and the frame
        lacks, and for channels of different sizes.
        """
        # Used, or the check would be dropped under a transformation.
        zero = 0 * checked_refresh_rate(refresh_rate)
        inputs = _inputs(frame, self.network)
        if self.other is None:
            return _quality(self, inputs, zero)
        # Not one program: it would copy the pictures on their way out of it.
        y = self.other.of_prepared(_prepared(self.network, inputs))
        return _of_transformed(self, y, zero)

    def count_outside(self, frame: Frame, refresh_rate: ArrayLike) -> Int[Array, ""]:
        """See `AbstractQualityOracle.count_outside`: a network judges everything."""
        return jnp.zeros((), int)

    def rate(
        self, frame: Frame, refresh_rate: ArrayLike, *, threshold: ArrayLike
    ) -> Int[Array, " tiles"]:
        """The method's own choice: the cheapest rate whose error is below a threshold.

        **Arguments:**

        - `frame`, `refresh_rate`: as for `quality`.
        - `threshold`: the same for all tiles. [`unit`], >= 0.

        **Returns:** index into `alsarr.RATES`, tiles row by row.

        **Raises:** as `quality` and `choose_mode`.

        **Source:** Cardoso et al. 2022, Section 4.2.
        """
        return choose_mode(-self.quality(frame, refresh_rate), threshold)


@eqx.filter_jit
def _quality(
    oracle: CnnOracle,
    inputs: tuple[Float[Array, "height width"], ...],
    zero: Float[Array, ""],
) -> Float[Array, "tiles 7"]:
    return _of_transformed(oracle, infer(oracle.network, _stacked(inputs)), zero)


@eqx.filter_jit
def _prepared(
    network: MetricNetwork, inputs: tuple[Float[Array, "height width"], ...]
) -> Float[Array, "channels high wide"]:
    return network.prepared(_stacked(inputs))


@eqx.filter_jit
def _of_transformed(
    oracle: CnnOracle,
    y: Float[Array, "outputs rows columns"],
    zero: Float[Array, ""],
) -> Float[Array, "tiles 7"]:
    network = oracle.network
    metric = in_own_unit(network, y, oracle.safe)
    errors = extrapolate(as_error(metric, network.metric), network.outputs)
    largest = _of_tiles(errors, TILE // network.region)
    return zero - largest.reshape(len(RATES), -1).T.astype(zero.dtype)


def _stacked(
    inputs: tuple[Float[Array, "height width"], ...],
) -> Float[Array, "channels height width"]:
    return jnp.stack([channel.astype(jnp.float32) for channel in inputs])


def _of_tiles(
    errors: Float[Array, "rates rows columns"], regions: int
) -> Float[Array, "rates tile_rows tile_columns"]:
    """The largest of each block of so many regions a side; the edge may cut some."""
    rates, rows, columns = errors.shape
    missing = ((0, 0), (0, -rows % regions), (0, -columns % regions))
    whole = jnp.pad(errors, missing, mode="edge")
    high, wide = (n // regions for n in whole.shape[1:])
    return whole.reshape(rates, high, regions, wide, regions).max(axis=(2, 4))


def _inputs(
    frame: Frame, network: MetricNetwork
) -> tuple[Float[Array, "height width"], ...]:
    """What the network looks at, in its order."""
    given = {} if frame.channels is None else frame.channels
    missing = [name for name in network.channels if name not in given]
    if missing:
        raise ValueError(
            f"`frame.channels` must have what the network looks at, "
            f"{', '.join(network.channels)}, but lacks {', '.join(missing)}."
        )
    inputs = tuple(given[name] for name in network.channels)
    sizes = {channel.shape for channel in inputs}
    if len(sizes) > 1:
        raise ValueError(
            f"`frame.channels` must have one height and width, got {sorted(sizes)}."
        )
    return inputs


def _check_network(network: MetricNetwork) -> None:
    if TILE % network.region:
        raise ValueError(
            f"`network` must have regions that divide a tile of {TILE} px, got "
            f"{network.region} px."
        )
    if not {"1x2", "2x1"} <= set(network.outputs):
        raise ValueError(
            f"`network` must predict 1x2 and 2x1, got {', '.join(network.outputs)}."
        )

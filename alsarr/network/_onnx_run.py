"""Networks run by onnxruntime, which is the faster of the two on a CPU."""

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from camojab._extras import needed

from ._model import in_own_unit, MetricNetwork
from ._onnx_export import INPUT, onnx_bytes


def session(network: MetricNetwork, threads: int | None) -> Any:
    """Of onnxruntime, for the graph of a network; arguments as for `OnnxNetwork`."""
    runtime = needed("onnx", "onnxruntime", "running ONNX graphs")
    if threads is not None and threads < 1:
        raise ValueError(f"`threads` must be > 0, got {threads}.")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = threads or 0
    # Errors only: it also warns of machines that will not have threads pinned.
    options.log_severity_level = 3
    # Threads that spin between calls take the cores from JAX, whose turn it is then.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    return runtime.InferenceSession(
        onnx_bytes(network), options, providers=["CPUExecutionProvider"]
    )


class OnnxNetwork:
    """A network whose calls are onnxruntime's, with the same results.

    It has the weights that the network had when it was made. Under jit the pictures
    leave the compiled program and come back, which copies them; outside of it, on a
    CPU, nothing is copied. No gradient goes through it, and vmap makes one batch of its
    pictures.

    **Arguments:**

    - `network`: with concrete weights.
    - `threads`: that onnxruntime works with. > 0; None leaves it the choice, which is
        one for each core.

    **Raises:** `ValueError` for a number of threads that is not positive; `ImportError`
    without the extra `onnx`.

    **Accuracy:** within 1e-5 of the network's own results
    (`tests/alsarr/test_alsarr_network_onnx.py`).
    """

    network: MetricNetwork

    def __init__(self, network: MetricNetwork, *, threads: int | None = None):
        self.network = network
        self._session = session(network, threads)

    def __call__(
        self, x: Float[Array, "channels height width"]
    ) -> Float[Array, "outputs rows columns"]:
        """As a call of the network."""
        return self.of_prepared(_prepared(self.network, x))

    def of_prepared(
        self, prepared: Float[Array, "channels high wide"]
    ) -> Float[Array, "outputs rows columns"]:
        """The same of what the network's `prepared` has made of the inputs."""
        prepared = prepared.astype(jnp.float32)
        # A callback hands its pictures over by copying them.
        if not isinstance(prepared, jax.core.Tracer):
            return jnp.asarray(self._run(prepared))
        region = self.network.region
        rows, columns = (n // region for n in prepared.shape[1:])
        shape = (len(self.network.outputs), rows, columns)
        result = jax.ShapeDtypeStruct(shape, jnp.float32)
        return jax.pure_callback(self._run, result, prepared, vmap_method="expand_dims")

    def predict(
        self, x: Float[Array, "channels height width"], *, safe: bool = True
    ) -> Float[Array, "outputs rows columns"]:
        """As the network's `predict`."""
        return in_own_unit(self.network, self(x), safe)

    def _run(self, prepared: Array) -> np.ndarray:
        pictures = np.asarray(prepared)
        batch = pictures.reshape(-1, *pictures.shape[-3:])
        (metric,) = self._session.run(None, {INPUT: batch})
        return metric.reshape(*pictures.shape[:-3], *metric.shape[1:])


@eqx.filter_jit
def _prepared(
    network: MetricNetwork, x: Float[Array, "channels height width"]
) -> Float[Array, "channels high wide"]:
    return network.prepared(x)

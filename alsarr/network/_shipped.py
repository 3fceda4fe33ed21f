from camojab._shipped import shipped

from ._file import load_network
from ._model import MetricNetwork


def shipped_network(metric: str) -> MetricNetwork:
    """The network that comes with the package for "flip" or "jnflip".

    What it was trained on and how well it predicts is in `data/networks.md`. It has
    learned how this package's own renderer shades: others should be trained on pictures
    of the renderer that they are to serve (Cardoso et al. 2022, Appendix C).

    **Raises:** `ValueError` for another metric.
    """
    if metric not in ("flip", "jnflip"):
        raise ValueError(f"`metric` must be flip or jnflip, got {metric}.")
    return load_network(shipped(f"network_{metric}.npz"))

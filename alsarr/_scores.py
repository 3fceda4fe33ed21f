"""Networks from files, and their scores as rows of a table."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TYPE_CHECKING


if TYPE_CHECKING:
    from .network import MetricNetwork, Samples


SHIPPED = ("network_flip.npz", "network_jnflip.npz")

FORMATS = {
    **{"r2": ".3f", "mae": ".3f", "mae_under": ".3f", "sigma": ".3f"},
    **{"r2_seen": ".3f", "r2_unseen": ".3f"},
}


def networks(paths: Sequence[Path] | None) -> dict[str, "MetricNetwork"]:
    """By the names of their files, which are those of what is drawn."""
    from camojab._shipped import shipped

    from .network import load_network

    files = list(paths) if paths else [shipped(name) for name in SHIPPED]
    loaded = {file.stem: load_network(file) for file in files}
    if len(loaded) < len(files):
        raise ValueError("`--network` must name files of different names.")
    for name, network in loaded.items():
        _check(name, network)
    return loaded


def _check(name: str, network: "MetricNetwork") -> None:
    """Whether what a network predicts can be measured on captured views."""
    from ._rates import TILE
    from .capture import CHANNELS
    from .metrics import METRICS

    unknown = [channel for channel in network.channels if channel not in CHANNELS]
    for good, rule, found in (
        (network.metric in METRICS, f"one of {', '.join(METRICS)}", network.metric),
        (network.region == TILE, f"tiles of {TILE} px", f"{network.region} px"),
        (not unknown, f"from channels of {', '.join(CHANNELS)}", ", ".join(unknown)),
    ):
        if not good:
            raise ValueError(f"`--network` must predict {rule}, got {found} in {name}.")


def samples(
    network: "MetricNetwork",
    paths: Sequence[Path],
    progress: Callable[[int, int], None],
) -> "Samples":
    """What the network is to predict from these views, measured."""
    from .network import load_samples

    return load_samples(
        paths,
        metric=network.metric,
        ppd=network.ppd,
        channels=network.channels,
        outputs=network.outputs,
        progress=progress,
    )


def rows(network: "MetricNetwork", judged: "Samples") -> list[dict[str, Any]]:
    """A row for every output and region."""
    from .network import evaluate

    return [asdict(score) for score in evaluate(network, judged)]


def overall(scored: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """One row: all outputs together, R2 also where tiles were seen and where not."""
    of = {row["tiles"]: row for row in scored if row["output"] == "all"}
    columns = {name: of["all"][name] for name in ("r2", "mae", "mae_under", "sigma")}
    return columns | {f"r2_{name}": of[name]["r2"] for name in ("seen", "unseen")}

"""`alsarr predict`: the error of every tile at every rate, before it is shaded."""

import zipfile
from pathlib import Path
from typing import Annotated, Literal, TYPE_CHECKING

import typer

from camojab import _command as command


if TYPE_CHECKING:
    from ._frame import Frame
    from .network import MetricNetwork


# Neither counts for a network: they are what a frame cannot be without.
_ANY_DISPLAY = {"ppd": 60.0, "refresh_rate": 60.0, "peak_luminance": 100.0}

# What the library calls the options.
_OPTIONS = {"`budget`": "`--budget`", "`threshold`": "`--threshold`"}


def predict(
    frame: Annotated[
        Path,
        typer.Argument(
            help="NPZ file of a view, as alsarr capture writes it, or of a frame with "
            "the channels that the network looks at."
        ),
    ],
    network: Annotated[
        Path | None,
        typer.Option(
            help="NPZ file of a network. That for FLIP that is shipped, if left out."
        ),
    ] = None,
    threshold: Annotated[
        float | None,
        typer.Option(
            help="Error, in the unit of the file's, below which a rate is good enough: "
            "the cheapest such rate is chosen, in the place of --budget."
        ),
    ] = None,
    budget: Annotated[
        float,
        typer.Option(
            help="Share of full rate everywhere for the rate map, from 0.0625 to 1."
        ),
    ] = 0.25,
    safe: Annotated[
        bool, typer.Option(help="With the network's offset against underestimation.")
    ] = True,
    backend: Annotated[
        Literal["jax", "onnxruntime"], typer.Option(help="What computes.")
    ] = "jax",
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The NPZ file to write, whole.")
    ] = Path("predicted.npz"),
) -> None:
    """Predict the error of every tile at each of the seven rates, and choose by it.

    The file has `error` and `rate`, both by row and column; alsarr preview and alsarr
    export read it. Errors are in the metric's own unit, but for PSNR, of which the root
    of the mean square error is taken: 0 where there is none, and 1 for black as white.
    """
    if output.suffix.lower() != ".npz" or output.is_dir():
        raise command.Unusable(f"{output}: must be a file to write that ends in .npz.")
    with command.usable(_OPTIONS):
        import numpy as np

        from camojab._files import replacing
        from camojab._shipped import shipped

        from ._rates import RATES
        from ._run import check_budget
        from ._viewpoint import best_rates
        from .network import load_network
        from .oracle import CnnOracle

        check_budget(budget)
        loaded: MetricNetwork = load_network(network or shipped("network_flip.npz"))
        given = _frame(frame)
        oracle = CnnOracle(loaded, safe=safe, backend=backend)
        refresh_rate = _ANY_DISPLAY["refresh_rate"]
        quality = oracle.quality(given, refresh_rate)
        if threshold is None:
            rate = best_rates(quality, budget).rate
        else:
            rate = oracle.rate(given, refresh_rate, threshold=threshold)
        maps = np.asarray(rate).reshape(given.shape)
        error = -np.asarray(quality).reshape(*given.shape, len(RATES))
        with replacing(output) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, rate=maps, error=error)
    share = RATES.cost[maps].mean() / RATES.cost.max()
    print(
        f"{output}: {oracle.unit} of {maps.size} tiles at {len(RATES)} rates, median "
        f"at 4x4 {np.median(error[..., 0]):.4g}; shading cost {share:.1%} of full rate"
    )


def _frame(path: Path) -> "Frame":
    """Of a view or a frame, whichever the file holds."""
    from ._frame import load_frame

    if not _is_view(path):
        return load_frame(path)
    from .capture import load_view

    return load_view(path).frame(**_ANY_DISPLAY)


def _is_view(path: Path) -> bool:
    from camojab._files import DAMAGED

    with path.open("rb") as file:
        try:
            return "images.npy" in zipfile.ZipFile(file).namelist()
        # What is wrong with the file is for its reader to say.
        except DAMAGED:
            return False

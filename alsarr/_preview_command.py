"""`alsarr preview`: a picture as its rate map would leave it, beside the map."""

from pathlib import Path
from typing import Annotated, TYPE_CHECKING

import typer

from camojab import _command as command


if TYPE_CHECKING:
    import numpy as np


def preview(
    image: Annotated[
        Path, typer.Argument(help="Picture, sRGB-encoded: PNG or what else is known.")
    ],
    rates: Annotated[
        Path,
        typer.Argument(
            help="NPZ file with the rates of its tiles, as alsarr solve writes it."
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The PNG file to write, whole.")
    ] = Path("preview.png"),
    columns: Annotated[
        int | None,
        typer.Option(
            help="Tiles in a row, where the file has but a list and the picture's size "
            "does not tell."
        ),
    ] = None,
) -> None:
    """Show a picture as coarse shading would leave it, beside the rate map.

    Each coarse pixel has the mean light of its pixels. Transparency is left out.
    """
    if output.suffix.lower() != ".png" or output.is_dir():
        raise command.Unusable(f"{output}: must be a file to write that ends in .png.")
    with command.usable({"`size_px`": str(image)}):
        from camojab._files import replacing

        from ._export_command import _rate_map
        from ._preview import coarse
        from ._rates import RATES
        from .export import adapt_rates
        from .plotting import shading_preview

        picture = _picture(image)
        size = picture.shape[1], picture.shape[0]
        rate = adapt_rates(_rate_map(rates, size, columns), size_px=size)
        figure = shading_preview(coarse(picture, rate), rate)
        with replacing(output) as temporary:
            figure.savefig(temporary, format="png", dpi=figure.dpi)
    cost = float(RATES.cost[rate].mean() / RATES.cost.max())
    print(f"{output}: {rate.size} tiles, shading cost {cost:.1%} of full rate")


def _picture(path: Path) -> "np.ndarray":
    """Red, green and blue of an image file, as stored."""
    import imageio.v3
    import numpy as np

    data = path.read_bytes()
    try:
        pixels = np.asarray(imageio.v3.imread(data, extension=path.suffix))
    # Each decoder has errors of its own for a file that it cannot read.
    except Exception as error:
        raise ValueError(f"{path}: must be an image that can be read.") from error
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[..., None], 3, axis=-1)
    if pixels.ndim != 3 or pixels.shape[-1] not in (3, 4):
        raise ValueError(
            f"{path}: must be one picture, grey or in colour, got an array of shape "
            f"{pixels.shape}."
        )
    if pixels.dtype.kind != "u":
        raise ValueError(f"{path}: must hold whole numbers, got {pixels.dtype}.")
    return pixels[..., :3]

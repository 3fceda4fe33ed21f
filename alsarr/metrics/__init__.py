"""How far a picture is from another, for each pixel and each tile."""

from ._flip import flip as flip
from ._hdr_flip import automatic_exposures as automatic_exposures, hdr_flip as hdr_flip
from ._lpips import (
    load_lpips_weights as load_lpips_weights,
    lpips as lpips,
    lpips_distance as lpips_distance,
    LpipsWeights as LpipsWeights,
    save_lpips_weights as save_lpips_weights,
)
from ._pooling import pool_tiles as pool_tiles
from ._psnr import (
    psnr as psnr,
    psnr_tiles as psnr_tiles,
    squared_error as squared_error,
)
from ._registry import (
    lpips_metric as lpips_metric,
    Metric as Metric,
    METRICS as METRICS,
)
from ._weber import jnflip as jnflip, jnyang as jnyang, weber as weber
from ._yang2019 import estimate_yang2019 as estimate_yang2019, yang2019 as yang2019

"""Figures, one function each, which returns a matplotlib `Figure` to save or show."""

from ._bench import error_and_throughput as error_and_throughput
from ._calibration import (
    quality_by_refresh_rate as quality_by_refresh_rate,
    quality_by_shading_rate as quality_by_shading_rate,
)
from ._curves import contour_map as contour_map, curves as curves
from ._fit import profile_likelihood as profile_likelihood
from ._models import (
    measured_and_predicted as measured_and_predicted,
    preferences as preferences,
    rmse_by_block as rmse_by_block,
)
from ._textures import amplitude_spectra as amplitude_spectra, textures as textures
from ._votes import (
    outlier_distances as outlier_distances,
    pair_residuals as pair_residuals,
    scaled_quality as scaled_quality,
)

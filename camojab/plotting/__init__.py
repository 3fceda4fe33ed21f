"""Figures, one function each, which returns a matplotlib `Figure` to save or show."""

from ._calibration import (
    quality_by_refresh_rate as quality_by_refresh_rate,
    quality_by_shading_rate as quality_by_shading_rate,
)

"""Figures: functions that return a `matplotlib.figure.Figure`."""

from ._control import (
    frame_buffers as frame_buffers,
    methods_compared as methods_compared,
    refresh_rates as refresh_rates,
    shading_preview as shading_preview,
)
from ._network import (
    predicted_errors as predicted_errors,
    rate_maps as rate_maps,
    view_buffers as view_buffers,
)

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
from ._oracles import (
    input_shares as input_shares,
    judged_twice as judged_twice,
    oracle_sheet as oracle_sheet,
    solver_gaps as solver_gaps,
    training_history as training_history,
)
from ._tables import (
    errors_by_size as errors_by_size,
    table_errors as table_errors,
    tile_rates as tile_rates,
)

from . import (
    export as export,
    oracle as oracle,
    plotting as plotting,
    solve as solve,
    tables as tables,
)
from ._frame import (
    Frame as Frame,
    frame_from_jindal2021 as frame_from_jindal2021,
    load_frame as load_frame,
    procedural_frame as procedural_frame,
    save_frame as save_frame,
)
from ._rates import RATES as RATES, ShadingRates as ShadingRates, TILE as TILE

from . import (
    capture as capture,
    explore as explore,
    export as export,
    metrics as metrics,
    network as network,
    oracle as oracle,
    plotting as plotting,
    solve as solve,
    tables as tables,
)
from ._budget import (
    AbstractCost as AbstractCost,
    Budget as Budget,
    MeasuredCost as MeasuredCost,
    PixelCost as PixelCost,
    TileCost as TileCost,
)
from ._controller import (
    Binding as Binding,
    Controller as Controller,
    Decision as Decision,
)
from ._frame import (
    DEFAULT_LUMINANCE as DEFAULT_LUMINANCE,
    Frame as Frame,
    frame_from_exr as frame_from_exr,
    frame_from_jindal2021 as frame_from_jindal2021,
    load_frame as load_frame,
    mean_velocity as mean_velocity,
    procedural_frame as procedural_frame,
    save_frame as save_frame,
    tile_luminance as tile_luminance,
)
from ._joint import joint_refresh as joint_refresh, JointRefresh as JointRefresh
from ._preview import coarse as coarse
from ._rates import RATES as RATES, ShadingRates as ShadingRates, TILE as TILE
from ._refresh import (
    every_rate as every_rate,
    refresh_table as refresh_table,
    RefreshChoice as RefreshChoice,
    RefreshTable as RefreshTable,
)

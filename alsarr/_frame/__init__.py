"""Frames, what is seen in each 16x16 tile and how it moves, and where they are from."""

from ._buffers import Frame as Frame, mean_velocity as mean_velocity
from ._exr import frame_from_exr as frame_from_exr
from ._file import load_frame as load_frame, save_frame as save_frame
from ._luminance import (
    DEFAULT_LUMINANCE as DEFAULT_LUMINANCE,
    tile_luminance as tile_luminance,
)
from ._procedural import procedural_frame as procedural_frame
from ._published import frame_from_jindal2021 as frame_from_jindal2021

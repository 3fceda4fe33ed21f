"""What the main job starts from: votes, textures and a frame, real or built in."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from camojab import datasets, fit, luminance

from ._frame import Frame, frame_from_jindal2021, procedural_frame
from .tables import AbstractTables, Scene, TablesJindal2021


@dataclass(frozen=True)
class Inputs:
    """Everything that a run reads.

    - `name`: of the data, as it is shown to people.
    - `observations`: measured quality, for the fit.
    - `published`: root mean square errors as printed for the same blocks, [JND], as
      text; empty where nothing was printed.
    - `textures`: relative luminance by name, for the tables.
    - `scene`: pairs of texture and mip level, and conditions, that the tables cover.
    - `frame`: whose tiles are to be shaded.
    - `tables`: of the frame's own textures, where they are not among `textures`.
    - `ppd` [px/deg] and `refresh_rate` [Hz]: of the display that shows the frame.
    """

    name: str
    observations: fit.Observations
    published: Mapping[str, str]
    textures: Mapping[str, Float[np.ndarray, "rows columns"]]
    scene: Scene
    frame: Frame
    tables: AbstractTables | None
    ppd: float
    refresh_rate: float


# Table 5 of Jindal et al. 2021, first row; "all" from Section 4.4.
_TABLE_5 = {
    "Block-PC": "0.74",
    "Block-Mobile": "0.57",
    "Block-VR": "0.53",
    "MARRR Exp. 1": "0.38",
    "MARRR Exp. 3": "0.03",
    "all": "0.53",
}


def builtin_inputs(*, ppd: float, refresh_rate: float) -> Inputs:
    """Simulated votes, scikit-image's and drawn textures, and a drawn frame."""
    textures = datasets.builtin_textures()
    frame = procedural_frame(len(textures), rows=68, columns=120, seed=2021)
    # The tables are to serve the refresh rates that the frame might be shown at too.
    rates = (min(30.0, refresh_rate), max(120.0, refresh_rate))
    scene = Scene.of_frames([frame], num_textures=len(textures), refresh_rate=rates)
    return Inputs(
        name="built-in data (simulated votes, drawn frame)",
        observations=fit.simulated(),
        published={},
        textures=textures,
        scene=scene,
        frame=frame,
        tables=None,
        ppd=ppd,
        refresh_rate=refresh_rate,
    )


def jindal2021_inputs(
    *, ppd: float, refresh_rate: float, frame_luminance: float
) -> Inputs:
    """The authors' votes, textures and SciFi frame with the tables of its materials.

    The frame's textures were never published, nor was its luminance: its materials
    have the authors' tables, and the tables made here are of the six published
    textures at every mip level that theirs have.
    """
    stored, materials = (
        datasets.jindal2021_frame(),
        datasets.jindal2021_material_tables(),
    )
    wood = luminance(datasets.jindal2021_sample_texture(), encoding="sRGB")
    textures = {**datasets.jindal2021_textures(), "wood": wood}
    return Inputs(
        name="jindal2021 (votes, textures and SciFi frame of Jindal et al. 2021)",
        observations=fit.jindal2021(),
        published=_TABLE_5,
        textures=textures,
        scene=Scene.every(len(textures)),
        frame=frame_from_jindal2021(
            motion_x=stored.motion_x,
            motion_y=stored.motion_y,
            material=stored.material,
            mip_level=stored.mip_level,
            ppd=ppd,
            refresh_rate=refresh_rate,
            luminance=frame_luminance,
        ),
        tables=TablesJindal2021(materials.coefficients, tuple(materials.names)),
        ppd=ppd,
        refresh_rate=refresh_rate,
    )

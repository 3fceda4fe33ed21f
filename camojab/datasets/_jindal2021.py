"""What Jindal et al. 2021 published: votes, JND, textures, a frame and its tables.

Source of every function: "Perceptual Model for Adaptive Local Shading and Refresh
Rate", ACM Trans. Graph. 40(6), doi:10.1145/3478513.3480514, and its repository
gfxdisp/ALSaRR at d06b3e02526d8cfa9a094c8223b115076703d29f (MIT).
"""

import io
import re
import zipfile
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64, Int, UInt8

from ._registry import fetch


if TYPE_CHECKING:
    import pandas


_TEXTURES = {
    "Checkerboard": "checkerboard",
    "Gradient": "gradient_linear",
    "Grass": "grass",
    "Noise": "noise",
}

_RATES = (1.0, 0.5, 0.25)

_VELOCITIES = {
    "PC": (0.0, 10.0, 30.0),
    "Mobile": (3.0, 10.0, 20.0),
    "VR": (10.0, 45.0, 75.0),
}

_BLOCKS = {
    "PC": {
        "mean_luminance_cd_m2": 150.0,
        "refresh_rate_hz": 144.0,
        "persistence": 1.0,
        "ppd": 50.0,
        "mip_level": 3,
    },
    "Mobile": {
        "mean_luminance_cd_m2": 75.0,
        "refresh_rate_hz": 60.0,
        "persistence": 1.0,
        "ppd": 90.0,
        "mip_level": 1,
    },
    "VR": {
        "mean_luminance_cd_m2": 2.5,
        "refresh_rate_hz": 144.0,
        "persistence": 0.05,
        "ppd": 26.0,
        "mip_level": 5,
    },
}


def jindal2021_votes() -> "pandas.DataFrame":
    """Experiment 1: every vote, 4764 rows in the order of the file.

    Two animations were shown side by side, of the same velocity and on the same
    display, and the observer picked the one with fewer artifacts.

    **Returns:** a table with the columns

    - `observer`: 13 identifiers.
    - `block`: `"PC"` (1644 votes), `"Mobile"` (1560) or `"VR"` (1560).
    - `velocity_deg_s`: horizontal velocity. [deg/s]
    - `texture_a`, `texture_b`: keys of `jindal2021_textures`.
    - `rate_x_a`, `rate_x_b`: horizontal shading resolution, 1, 1/2 or 1/4. At rate 1
        nothing distinguishes the textures' references, so the authors scale them as
        one condition.
    - `a_preferred`: whether a was chosen over b.
    - `refresh_rate_hz`, `mean_luminance_cd_m2`, `persistence`: the display, as the file
        states it. The file has persistence 0.04 for the block VR, where Table 3 and the
        authors' fit have 0.05.
    - `screen_width_px`, `screen_height_px`, `field_of_view_x_deg`: as in the file. The
        resolutions of Table 3 do not follow from them; see `jindal2021_jnd`.

    The file's contrasts are left out because the texture determines them: they are half
    the Michelson contrasts of Table 3 (0.7 checkerboard, 0.8 noise, 0.9 the others).

    **Raises:** as `fetch`.
    """
    import pandas as pd

    raw = pd.read_csv(fetch("jindal2021/Experiment_Data/vrs_exp_data.csv"))
    # The file prints float32 numbers with fifteen digits.
    number = lambda column: raw[column].astype(float).round(6)
    return pd.DataFrame(
        {
            "observer": raw["Observer"],
            "block": raw["Config"].str.removeprefix("Block"),
            "velocity_deg_s": number("Stimulus1_xvelolicty"),
            "texture_a": raw["Stimulus1_type"].map(_TEXTURES.__getitem__),
            "rate_x_a": number("Stimulus1_resolution"),
            "texture_b": raw["Stimulus2_type"].map(_TEXTURES.__getitem__),
            "rate_x_b": number("Stimulus2_resolution"),
            "a_preferred": raw["User_Selection"] == 1,
            "refresh_rate_hz": number("Stimulus1_refresh_rate"),
            "mean_luminance_cd_m2": number("Stimulus1_mean_lum"),
            "persistence": number("Stimulus1_persistence"),
            "screen_width_px": raw["screen_width"],
            "screen_height_px": raw["screen_height"],
            "field_of_view_x_deg": number("Stimulus1_fovx"),
        }
    )


def jindal2021_jnd() -> "pandas.DataFrame":
    """Experiment 1 scaled by its authors: 108 rows, a quality loss each.

    One row per block, velocity, texture and shading resolution, with the inputs that
    the authors gave their model when they fitted it to this table.

    **Returns:** a table with the columns

    - `block`, `texture`: as in `jindal2021_votes`.
    - `velocity_deg_s`: velocity shown in the experiment. [deg/s]
    - `tracked_velocity_deg_s`: |velocity - 2|, which enters the model. [deg/s] The
        objects also turned, at less than 2 deg/s, and the authors take these off the
        velocity; the still image of the block PC thus moves at 2 deg/s.
    - `mean_luminance_cd_m2`, `refresh_rate_hz`, `persistence`, `ppd`, `mip_level`: the
        display and the mip level at full rate. The panel of the block VR has 13 px/deg;
        26 stands for its twofold supersampling.
    - `rate_x`: 1, 1/2 or 1/4; `rate_y`: 1, although the stimuli were shaded at half the
        vertical resolution throughout (1x2, 2x2 and 4x2; appendix A.2).
    - `quality_jnd`: quality relative to `rate_x` 1, which is 0 and one condition for
        all four textures. [JND]
    - `low_jnd`, `high_jnd`: ends of the 95 % interval from 100 bootstraps over
        observers. [JND] The file holds distances from the quality, not ends: all are
        positive, where every end would follow the quality below zero. At rate 1 they
        are not zero, because the reference is subtracted once, not in each bootstrap.

    **Raises:** as `fetch`.

    **Source:** `vrs_exp_data_jnd.mat` (axes: texture, rate, velocity, block), and the
    conditions from `CaMoJAB/fits/train_camojab.m`.
    """
    import pandas as pd
    from scipy.io import loadmat

    scaled = loadmat(fetch("jindal2021/Experiment_Data/vrs_exp_data_jnd.mat"))
    rows = []
    for b, (block, display) in enumerate(_BLOCKS.items()):
        for v, velocity in enumerate(_VELOCITIES[block]):
            for t, texture in enumerate(_TEXTURES.values()):
                for r, rate in enumerate(_RATES):
                    quality, low, high = (
                        float(scaled[name][t, r, v, b])
                        for name in ("GT", "ErrorLow", "ErrorHigh")
                    )
                    rows.append(
                        {
                            "block": block,
                            "texture": texture,
                            "velocity_deg_s": velocity,
                            "tracked_velocity_deg_s": abs(velocity - 2.0),
                            **display,
                            "rate_x": rate,
                            "rate_y": 1.0,
                            "quality_jnd": quality,
                            "low_jnd": quality - low,
                            "high_jnd": quality + high,
                        }
                    )
    return pd.DataFrame(rows)


def jindal2021_textures() -> dict[str, Float64[np.ndarray, "512 512"]]:
    """The five textures that the authors' model was fitted with, by their names there.

    **Returns:** arrays indexed (y, x), relative luminance in [0, 1], not encoded:
    `checkerboard`, `gradient_linear`, `grass` and `noise` of Experiment 1, and
    `marrr_checkerboard`, which stands for the stimuli of Denes et al. 2020. The mean of
    each is 0.5, but 0.32 for the last and 0.019 for grass, whose Michelson contrast of
    0.996 is not the 0.9 of Table 3 either.

    **Raises:** as `fetch`.
    """
    from scipy.io import loadmat

    raw = loadmat(fetch("jindal2021/Experiment_Data/vrs_exp_stimulus.mat"))
    names = (*_TEXTURES.values(), "marrr_checkerboard")
    return {name: raw[name].astype(np.float64, order="C") for name in names}


def jindal2021_sample_texture() -> UInt8[np.ndarray, "1024 1024 4"]:
    """The wood texture of the authors' example: RGBA as stored, opaque, sRGB-encoded.

    The authors' example takes the grey of its code values, without decoding them, as
    luminance.

    **Raises:** as `fetch`.
    """
    from skimage.io import imread

    return imread(fetch("jindal2021/CaMoJAB/sample_texture.png"))


def jindal2021_validation_votes() -> "pandas.DataFrame":
    """Experiment 2: ALSaRR against another method in a moving scene, 1297 votes.

    12 observers made 108 comparisons each; the file has one more, of `fz261`.

    **Returns:** a table with the columns

    - `observer`.
    - `scene`: `"lemon"`, `"sally"` or `"scifi"`.
    - `motion`: `"fly_through_forward"`, `"fly_through_parallax"` or
        `"fly_through_random"` (the camera on a fixed path), or `"first_person"` or
        `"third_person"` (the observer moved it).
    - `budget`: shaded pixels a second as a fraction of 1920 x 1080 at 120 Hz, 0.0625 or
        0.125.
    - `against`: `"uniform"` (one shading rate and one refresh rate) or `"marrr"`.
    - `uniform_setting`: coarse pixel of the uniform rate, width x height. It was shown
        at budget x 120 Hz x width x height, 30 to 120 Hz. Always `"1x1"` for MARRR,
        which chose resolution and refresh rate itself.
    - `alsarr_preferred`: whether ALSaRR was chosen.

    **Raises:** as `fetch`.
    """
    import pandas as pd

    raw = pd.read_csv(
        fetch("jindal2021/Experiment_Data/alsarr_validation_experiment.csv")
    )
    parts = raw["scene"].str.split("[-_]", n=1, regex=True, expand=True)
    scenes = {"LemonChanged": "lemon", "Sally": "sally", "SciFi": "scifi"}
    rivals = {"UNIFORM_VRS": "uniform", "MARRR": "marrr"}
    snake = lambda camel: re.sub(r"(?<=[a-z])(?=[A-Z])", "_", camel).lower()
    coarse = raw["uniform setting"].str.extract(r"(\dX\d)_PIXELS", expand=False)
    return pd.DataFrame(
        {
            "observer": raw["id"],
            "scene": parts[0].map(scenes.__getitem__),
            "motion": parts[1].map(snake),
            "budget": raw["budget"],
            "against": raw["against"].map(rivals.__getitem__),
            "uniform_setting": coarse.str.lower().fillna("1x1"),
            "alsarr_preferred": raw["answer"] == 1,
        }
    )


@dataclass(frozen=True, eq=False)
class Jindal2021Frame:
    """One frame of the SciFi scene, a value for each whole 16x16 tile of 1920 x 1080.

    - `motion_x`, `motion_y`: smallest motion along each axis in the tile, as stored:
        percent of the screen's width (of its height) a frame, >= 0. The comment in the
        authors' example says pixels a frame, its arithmetic says percent. See
        `velocity_deg_s`.
    - `material`: index into `Jindal2021Materials`, from 0.
    - `mip_level`: mip level of the texture, 0 to 11.
    """

    motion_x: Float64[np.ndarray, "67 120"]
    motion_y: Float64[np.ndarray, "67 120"]
    material: Int[np.ndarray, "67 120"]
    mip_level: Int[np.ndarray, "67 120"]

    def velocity_deg_s(
        self, *, refresh_rate_hz: float | int, ppd: float | int
    ) -> Float64[np.ndarray, "67 120 2"]:
        """Velocity of each tile along x and y if frames follow at `refresh_rate_hz`.

        **Arguments:**

        - `refresh_rate_hz`: frames a second. [Hz], > 0. The authors use 60.
        - `ppd`: pixels per visual degree of the 1920 x 1080 screen. [px/deg], > 0. The
            authors use 60.

        **Returns:** [deg/s], >= 0.

        **Raises:** `ValueError` if either is not positive and finite.

        **Source:** `ALSaRR/adaptive_vrs.m`.
        """
        for name, value in (("refresh_rate_hz", refresh_rate_hz), ("ppd", ppd)):
            if not 0 < value < np.inf:
                raise ValueError(f"`{name}` must be > 0 and finite, got {value:g}.")
        pixels = np.stack([self.motion_x * 1920, self.motion_y * 1080], axis=-1) / 100
        return pixels * (refresh_rate_hz / ppd)


def jindal2021_frame() -> Jindal2021Frame:
    """The frame of the authors' example, without its luminance.

    The tiles are 67 whole rows of 120: the lowest half row of the screen is not there,
    nor is the picture that the tiles' luminance came from (`frame_n.exr`, missing from
    the repository).

    **Raises:** as `fetch`.
    """
    motion = _pixels("motion_n.exr")
    material = _pixels("materials_n.exr")
    return Jindal2021Frame(
        motion_x=motion[..., 0].astype(np.float64),
        motion_y=motion[..., 1].astype(np.float64),
        material=material[..., 0].astype(np.int64),
        mip_level=material[..., 1].astype(np.int64),
    )


def _pixels(file: str) -> np.ndarray:
    import OpenEXR

    path = fetch(f"jindal2021/ALSaRR/sample_data/{file}")
    with OpenEXR.File(str(path)) as image:
        return np.array(image.channels()["RGBA"].pixels)


@dataclass(frozen=True, eq=False)
class Jindal2021Materials:
    """The polynomials of the 50 materials of the SciFi scene.

    - `names`: sorted, so that the position is the index used by `Jindal2021Frame`.
    - `coefficients`: indexed (material, mip level, shading resolution, term), where the
        shading resolutions are 1/2 and 1 along one axis, and the quality is relative to
        1/4. The ten terms w give, for velocity v [deg/s], refresh rate f [Hz] and
        z = log10 of the luminance in cd/m2,
        (w0 + w1 v + w2 f + w3 v^2 + w4 v f + w5 f^2) (w6 z^3 + w7 z^2 + w8 z + w9)
        [JND].
    """

    names: tuple[str, ...]
    coefficients: Float64[np.ndarray, "50 12 2 10"]


def jindal2021_material_tables() -> Jindal2021Materials:
    """The authors' own fit of their model to each texture, for `jindal2021_frame`.

    Three of the fifty differ from the others: `0000skybox` has the same polynomials at
    all mip levels, `MarketWallStone (Instance)` zeros at level 0 (where the authors'
    fit failed), and `zzzzUniform`, for surfaces without texture, nothing but zeros.

    **Raises:** as `fetch`.

    **Source:** `all_polynomials.zip`; the formula is Eq. 31, written out in
    `ALSaRR/adaptive_vrs.m`.
    """
    path = fetch("jindal2021/ALSaRR/sample_data/all_polynomials.zip")
    with zipfile.ZipFile(path) as archive:
        members = sorted(n for n in archive.namelist() if n.endswith(".mat"))
        tables = np.stack([_polynomials(archive.read(member)) for member in members])
    names = tuple(PurePosixPath(member).stem for member in members)
    return Jindal2021Materials(names=names, coefficients=tables)


def _polynomials(file: bytes) -> Float64[np.ndarray, "12 2 10"]:
    from scipy.io import loadmat

    poly = loadmat(io.BytesIO(file))["poly"][0, 0]
    both = [poly["coeff_half"], poly["coeff_full"]]
    return np.stack(both, axis=1).astype(np.float64)

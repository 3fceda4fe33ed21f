"""Figures of other authors, digitised by Jindal et al. 2021 and shipped here."""

from typing import TYPE_CHECKING

from .._shipped import shipped


if TYPE_CHECKING:
    import pandas


def mackin2016() -> "pandas.DataFrame":
    """Impairment of real motion under a strobe light, 7 rates at 4 velocities.

    Jindal et al. 2021 compare this with their model for a checkerboard at 60 px/deg,
    150 cd/m2, persistence 0.1, full rate and mip level 1, scaled and shifted to fit.

    **Returns:** 28 rows with the columns

    - `velocity_deg_s`: 10, 30, 50 or 70. [deg/s]
    - `refresh_rate_hz`: 60 to 2000. [Hz]
    - `mean_impairment_score`: mean opinion from 1 (worst) to 5 (imperceptible).
    - `low_score`, `high_score`: ends of the published error bars.

    **Raises:** nothing.

    **Source:** A. Mackin, K. C. Noland and D. R. Bull, "The visibility of motion
    artifacts and their effect on motion quality", IEEE ICIP 2016, 2435-2439; digitised
    in `CaMoJAB/fits/test_camojab.m` of gfxdisp/ALSaRR at d06b3e0 (MIT).
    """
    return _table("mackin2016.csv")


def itu_bt2246_refresh_rate() -> "pandas.DataFrame":
    """Quality of video against frame rate and shutter, 6 rows.

    Jindal et al. 2021 compare this with their model for a checkerboard at 57 px/deg
    (three picture heights), 300 cd/m2, persistence 1, 20 deg/s, full rate and mip level
    1, scaled and shifted to fit; the stimuli were natural video, of unpublished motion.
    They leave out the two rows with a shutter of 0.5, which their model does not have.

    **Returns:** a table with the columns

    - `refresh_rate_hz`: 30 to 240. [Hz]
    - `shutter`: open fraction of the camera's frame.
    - `quality_score`: relative quality; 240 Hz is about 0, lower is worse.
    - `low_score`, `high_score`: ends of the 95 % interval.

    **Raises:** nothing.

    **Source:** Report ITU-R BT.2246, "The present state of ultra-high definition
    television", figure 20; digitised as `mackin2016`.
    """
    return _table("itu_bt2246_refresh_rate.csv")


def itu_bt2246_resolution() -> "pandas.DataFrame":
    """Quality of video against resolution and upscaling filter, 6 rows.

    Jindal et al. 2021 compare this with their model for a checkerboard at 59 px/deg
    (1.5 picture heights), 300 cd/m2, 60 Hz, persistence 1, 6 deg/s and mip level 0,
    scaled and shifted to fit, with `rate_x` as in the column `rate` and `rate_y` 1,
    although the resolution was reduced along both axes. They leave out the rows
    upscaled by a Lanczos filter, which their model does not have.

    **Returns:** a table with the columns

    - `width_px`, `height_px`: resolution before upscaling. [px]
    - `upscaling`: `"nearest"`, `"Lanczos"` or `"none"`.
    - `rate`: that resolution over 3840 x 2160, along each axis.
    - `quality_score`: perceived quality, 0 (worst) to 100.
    - `low_score`, `high_score`: ends of the published error bars.

    **Raises:** nothing.

    **Source:** Report ITU-R BT.2246, "The present state of ultra-high definition
    television", figure 7; digitised as `mackin2016`.
    """
    return _table("itu_bt2246_resolution.csv")


def _table(name: str) -> "pandas.DataFrame":
    import pandas as pd

    # `keep_default_na` off: the word "none" is a value here.
    table = pd.read_csv(shipped(name), keep_default_na=False)
    integers = [c for c in table.select_dtypes("integer") if not c.endswith("_px")]
    return table.astype(dict.fromkeys(integers, float))

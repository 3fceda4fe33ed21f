"""The eight columns of Table 5: what was measured, and under which conditions."""

from typing import Any

from .. import datasets, fit


def measurements() -> fit.Observations:
    """Every value that the models of Jindal et al. 2021 are compared on, 219 rows.

    The 184 of `camojab.fit.jindal2021`, on which CaMoJAB's constants were fitted, and
    35 of Mackin et al. 2016 and Report ITU-R BT.2246, on which they were not. The
    conditions of the latter are those that Jindal et al. gave their model: a moving
    checkerboard, because the stimuli were not published, at

    - 60 px/deg, 150 cd/m^2, persistence 0.1, mip level 1 (Mackin et al.);
    - 57 px/deg, 300 cd/m^2, persistence 1, 20 deg/s, mip level 1 (refresh rate; only
      the rows with a fully open shutter);
    - 59 px/deg, 300 cd/m^2, persistence 1, 60 Hz, 6 deg/s, mip level 0, resolution
      reduced along the motion only (resolution; only nearest-neighbour upscaling).

    **Returns:** observations whose table has the columns of `fit.jindal2021` and

    - `measured`: the value in the unit of the column `unit`, relative to the row
      `reference` for JND, and as published for opinion scores. It takes the place of
      `quality_jnd`; there are no intervals.
    - `shown_velocity_deg_s`: of the stimulus on the screen. For the blocks of
      Experiment 1 `velocity_deg_s` is |shown - 2|, as the authors' fit takes it.

    **Raises:** as `camojab.datasets.fetch`.

    **Source:** Jindal et al. 2021, Table 5 and section 4.6; the conditions are in
    `CaMoJAB/fits/test_camojab.m` of gfxdisp/ALSaRR at d06b3e0 (MIT).
    """
    import pandas as pd

    fitted = fit.jindal2021()
    table: Any = fitted.table.rename(columns={"quality_jnd": "measured"})
    table = table.drop(columns=["low_jnd", "high_jnd"]).assign(unit="JND")
    table["shown_velocity_deg_s"] = table["velocity_deg_s"]
    blocks = table["data_set"] == "jindal2021"
    # Both tables list the blocks in the order of the authors' file.
    shown = datasets.jindal2021_jnd()["velocity_deg_s"].to_numpy()
    table.loc[blocks, "shown_velocity_deg_s"] = shown
    opinions: Any = pd.concat(
        [_mackin2016(), _itu_refresh_rate(), _itu_resolution()], ignore_index=True
    )
    # Opinions are compared as they are, so each row is its own reference.
    opinions["reference"] = len(table) + opinions.index
    whole: Any = pd.concat([table, opinions], ignore_index=True)
    return fit.Observations(whole, fitted.textures)


def _mackin2016() -> Any:
    raw: Any = datasets.mackin2016()
    return _opinions(
        "Mackin",
        raw["mean_impairment_score"],
        "score, 1 to 5",
        data_set="mackin2016",
        velocity_deg_s=raw["velocity_deg_s"],
        refresh_rate_hz=raw["refresh_rate_hz"],
        mean_luminance_cd_m2=150.0,
        ppd=60.0,
        persistence=0.1,
        mip_level=1,
    )


def _itu_refresh_rate() -> Any:
    raw: Any = datasets.itu_bt2246_refresh_rate()
    raw = raw[raw["shutter"] == 1]
    return _opinions(
        "ITU-R FPS",
        raw["quality_score"],
        "score, about -3 to 0",
        data_set="itu_bt2246_refresh_rate",
        velocity_deg_s=20.0,
        refresh_rate_hz=raw["refresh_rate_hz"],
        mean_luminance_cd_m2=300.0,
        ppd=57.0,
        mip_level=1,
    )


def _itu_resolution() -> Any:
    raw: Any = datasets.itu_bt2246_resolution()
    raw = raw[raw["upscaling"] != "Lanczos"]
    return _opinions(
        "ITU-R PPD",
        raw["quality_score"],
        "score, 0 to 100",
        data_set="itu_bt2246_resolution",
        velocity_deg_s=6.0,
        refresh_rate_hz=60.0,
        mean_luminance_cd_m2=300.0,
        ppd=59.0,
        rate_x=raw["rate"],
        mip_level=0,
    )


def _opinions(
    block: str,
    score: Any,
    unit: str,
    *,
    data_set: str,
    velocity_deg_s: Any,
    refresh_rate_hz: Any,
    mean_luminance_cd_m2: float,
    ppd: float,
    mip_level: int,
    persistence: float = 1.0,
    rate_x: Any = 1.0,
) -> Any:
    import pandas as pd

    return pd.DataFrame(
        {
            "texture": "checkerboard",
            "mean_luminance_cd_m2": mean_luminance_cd_m2,
            "refresh_rate_hz": refresh_rate_hz,
            "velocity_deg_s": velocity_deg_s,
            "shown_velocity_deg_s": velocity_deg_s,
            "persistence": persistence,
            "ppd": ppd,
            "rate_x": rate_x,
            "rate_y": 1.0,
            "mip_level": mip_level,
            "data_set": data_set,
            "block": block,
            "temporal_only": False,
            "measured": score,
            "unit": unit,
        }
    )

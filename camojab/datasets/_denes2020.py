"""Quality against refresh rate measured by Denes et al. 2020.

Source of every function: "A perceptual model of motion quality for rendering with
adaptive refresh-rate and resolution", ACM Trans. Graph. 39(4),
doi:10.1145/3386569.3392411. The files are in two repositories: the authors' own,
gfxdisp/motion_quality_20 (`denes2020/`), and gfxdisp/ALSaRR (`jindal2021/`), where the
conditions of each row come from (`CaMoJAB/fits/train_camojab.m`). Both are MIT.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ._registry import fetch


if TYPE_CHECKING:
    import pandas


_REFRESH_RATES = tuple(range(50, 170, 5))

_CONDITIONS = {
    "texture": "marrr_checkerboard",
    "mean_luminance_cd_m2": 100.0,
    "persistence": 1.0,
    "ppd": 2560 / 30,
    "rate_x": 1.0,
    "rate_y": 1.0,
    "mip_level": 1,
}


@dataclass(frozen=True)
class _Stimulus:
    column: str
    matrix: str
    velocity_deg_s: float
    predictable: bool = True


# The authors' spelling, "perdictable" and "degs", is part of the names.
_STIMULI = {
    "checkerboard_15": _Stimulus(
        "JOD_15degps_predictable", "pwc_mat_15degs_perdictable", 15.0
    ),
    "checkerboard_30": _Stimulus(
        "JOD_30degps_predictable", "pwc_mat_30degs_perdictable", 30.0
    ),
    "checkerboard_45": _Stimulus(
        "JOD_45degps_predictable", "pwc_mat_45degs_perdictable", 45.0
    ),
    "eye_tracker_target_15": _Stimulus(
        "JOD_15degps_ET_target", "pwc_mat_15degps_ET_target", 15.0
    ),
    "checkerboard_unpredictable_23": _Stimulus(
        "JOD_23degps_unpredictable", "pwc_mat_23degps_unpredictable", 23.0, False
    ),
    "panorama_30": _Stimulus("JOD_30degps_panorama", "pwc_mat_30degps_panorama", 30.0),
}


def denes2020_exp1_jnd() -> "pandas.DataFrame":
    """Experiment 1, predictable motion, as Jindal et al. 2021 fitted it: 72 rows.

    A checkered disc moved to and fro on a sinusoid, at 24 refresh rates and three peak
    velocities.

    **Returns:** a table with the inputs of the model (`texture`,
    `mean_luminance_cd_m2`, `persistence`, `ppd`, `rate_x`, `rate_y`, `mip_level`: the
    same in all rows) and

    - `velocity_deg_s`: peak velocity, 15, 30 or 45. [deg/s]
    - `refresh_rate_hz`: 50 to 165 in steps of 5. [Hz]
    - `quality_jnd`: relative to 50 Hz at the same velocity. [JND]
    - `joint_quality_jnd`: relative to 50 Hz at 15 deg/s, on one scale for the three
        velocities, from comparisons across velocities too. [JND]
    - `low_jnd`, `high_jnd`: ends of the interval around `quality_jnd`, 75 % by the
        name of its file. [JND] Not zero wide at 50 Hz.

    **Raises:** as `fetch`.

    **Source:** `marrr_exp1_jnds.mat`, first three of its seven stimuli, and
    `marrr_exp1_confidence75.mat`, which has one distance for both directions.
    """
    import pandas as pd
    from scipy.io import loadmat

    folder = "jindal2021/Experiment_Data/external_data"
    joint = loadmat(fetch(f"{folder}/marrr_exp1_jnds.mat"))["res"]["JODs"][0, 0]
    distance = loadmat(fetch(f"{folder}/marrr_exp1_confidence75.mat"))["errors"]
    rows = []
    for v, velocity in enumerate((15.0, 30.0, 45.0)):
        quality = joint[v] - joint[v, 0]
        for f, refresh_rate in enumerate(_REFRESH_RATES):
            rows.append(
                {
                    **_CONDITIONS,
                    "velocity_deg_s": velocity,
                    "refresh_rate_hz": float(refresh_rate),
                    "quality_jnd": float(quality[f]),
                    "joint_quality_jnd": float(joint[v, f]),
                    "low_jnd": float(quality[f] - distance[0, v, f]),
                    "high_jnd": float(quality[f] + distance[1, v, f]),
                }
            )
    return pd.DataFrame(rows)


def denes2020_exp1_all() -> "pandas.DataFrame":
    """Experiment 1, all six published stimuli as scaled by the authors: 144 rows.

    **Returns:** a table with the columns

    - `stimulus`: `"checkerboard_15"`, `"checkerboard_30"`, `"checkerboard_45"`,
        `"eye_tracker_target_15"`, `"checkerboard_unpredictable_23"` or `"panorama_30"`.
    - `velocity_deg_s`: peak velocity; the mean for the unpredictable one. [deg/s]
    - `predictable`: false for the stimulus that the authors call unpredictable. They
        do not label the eye tracker's target and the panorama either way.
    - `refresh_rate_hz`: 50 to 165 in steps of 5. [Hz]
    - `quality_jnd`: relative to 50 Hz of the same stimulus. [JND]

    **Raises:** as `fetch`.

    **Source:** `exp1_scaled_results.csv`.
    """
    import pandas as pd

    raw = pd.read_csv(fetch("denes2020/data/exp1_scaled_results.csv"))
    tables = [
        pd.DataFrame(
            {
                "stimulus": name,
                "velocity_deg_s": stimulus.velocity_deg_s,
                "predictable": stimulus.predictable,
                "refresh_rate_hz": raw["FPS"].astype(float),
                "quality_jnd": raw[stimulus.column].astype(float),
            }
        )
        for name, stimulus in _STIMULI.items()
    ]
    return pd.concat(tables, ignore_index=True)


def denes2020_exp1_comparisons() -> "pandas.DataFrame":
    """Experiment 1, the counts behind `denes2020_exp1_all`.

    **Returns:** one row for each pair of refresh rates that was compared, with the
    columns

    - `stimulus`: as in `denes2020_exp1_all`.
    - `refresh_rate_a_hz` < `refresh_rate_b_hz`. [Hz]
    - `a_wins`, `b_wins`: how often each was preferred. They add up to 660 for every
        stimulus (661 for the eye tracker's target).

    **Raises:** as `fetch`.

    **Source:** `pairwise_comparison_matrices.mat`. Element (i, j) of a matrix counts
    votes for rate i over rate j: with this reading the higher rate wins 64 to 73 % of
    the votes for each stimulus, in step with the authors' JND.
    """
    import pandas as pd
    from scipy.io import loadmat

    raw = loadmat(fetch("denes2020/data/pairwise_comparison_matrices.mat"))
    rates = np.array(_REFRESH_RATES, float)
    a, b = np.triu_indices(len(rates), 1)
    tables = []
    for name, stimulus in _STIMULI.items():
        # The counts are bytes, and sums of bytes would wrap around.
        wins = raw[stimulus.matrix].astype(int)
        table = pd.DataFrame(
            {
                "stimulus": name,
                "refresh_rate_a_hz": rates[a],
                "refresh_rate_b_hz": rates[b],
                "a_wins": wins[a, b],
                "b_wins": wins[b, a],
            }
        )
        tables.append(table[table["a_wins"] + table["b_wins"] > 0])
    return pd.concat(tables, ignore_index=True)


def denes2020_exp3_jnd() -> "pandas.DataFrame":
    """Experiment 3: what judder alone costs at four refresh rates.

    Each rate f was compared with 2f, with the blur of both made equal, so that only the
    judder differed.

    **Returns:** four rows with the inputs of the model (as in `denes2020_exp1_jnd`,
    `velocity_deg_s` 25) and

    - `refresh_rate_hz`: 50, 60, 72 or 82.5. [Hz]
    - `loss_jnd`: quality lost to 2f when the motion is predictable, minus that at
        82.5 Hz. [JND], >= 0. It falls as the rate rises, unlike every `quality_jnd`,
        and is what the temporal distortion, relative to 82.5 Hz, is fitted to.
    - `loss_unpredictable_jnd`: the same for unpredictable motion, which Jindal et al.
        do not use. [JND], >= 0.

    **Raises:** as `fetch`.

    **Source:** `marrr_exp3_jnds.mat`.
    """
    import pandas as pd
    from scipy.io import loadmat

    path = "jindal2021/Experiment_Data/external_data/marrr_exp3_jnds.mat"
    raw = loadmat(fetch(path))
    return pd.DataFrame(
        {
            **_CONDITIONS,
            "velocity_deg_s": 25.0,
            "refresh_rate_hz": raw["f"][:, 0],
            "loss_jnd": raw["Q"][:, 0],
            "loss_unpredictable_jnd": raw["Q"][:, 1],
        }
    )

"""Make `simulated_conditions.csv` and `simulated_votes.csv`.

A Thurstone Case V observer votes on the built-in textures in three experiments laid
out like those that the model was calibrated with. Its opinion is the released model
with the published constants and the published scale of each experiment. Run as

    python data/simulate_votes.py

and the two files beside this script are written anew, the same to the byte.
"""

import itertools
from pathlib import Path

import jax
import numpy as np
import pandas

from camojab import Display, distortion, Parameters, Shading, Spectrum, Viewing
from camojab.datasets import builtin_textures, displays
from camojab.votes import simulate


SEED = 20211210
OBSERVERS = 14
SCALES = {"rates": 0.6648857837, "refresh": 1.4582855229, "judder": 1.1912492435}
VELOCITIES = {
    "jindal2021_pc": (0.0, 10.0, 30.0),
    "jindal2021_mobile": (3.0, 10.0, 20.0),
    "jindal2021_vr": (10.0, 45.0, 75.0),
}
BLOCKS = {"jindal2021_pc": "PC", "jindal2021_mobile": "Mobile", "jindal2021_vr": "VR"}
MIP_LEVELS = {"jindal2021_pc": 3, "jindal2021_mobile": 1, "jindal2021_vr": 5}


def session(name, data_set, block, display, **columns):
    """Conditions that are voted on together; the first is what the rest refer to."""
    columns = {"rate_x": 1.0, "rate_y": 1.0, **columns}
    return {
        "session": name,
        "data_set": data_set,
        "block": block,
        "temporal_only": data_set == "judder",
        "mean_luminance_cd_m2": display.mean_luminance_cd_m2,
        "refresh_rate_hz": display.refresh_rate_hz,
        "persistence": display.persistence,
        "ppd": display.ppd,
        **columns,
    }


def conditions():
    preset = displays().set_index("name")
    rows = []
    for display, velocities in VELOCITIES.items():
        for velocity in velocities:
            for texture in ("checkerboard", "gradient", "grass", "noise"):
                for m in (1, 2, 4):
                    rows.append(
                        session(
                            f"{BLOCKS[display]} {velocity:g} deg/s",
                            "rates",
                            f"simulated {BLOCKS[display]}",
                            preset.loc[display],
                            velocity_deg_s=velocity,
                            texture=texture,
                            rate_x=1.0 / m,
                            mip_level=MIP_LEVELS[display],
                            # Full rate is one condition, whatever the texture.
                            condition="full" if m == 1 else f"{texture} {m}x1",
                        )
                    )
    for velocity in (15.0, 30.0, 45.0):
        for rate in range(50, 170, 15):
            rows.append(refresh(preset, "refresh", velocity, float(rate)))
    for rate in (82.5, 72.0, 60.0, 50.0):
        rows.append(refresh(preset, "judder", 25.0, rate))
    table = pandas.DataFrame(rows)
    alike = ["session", "texture"]
    table["reference"] = table.groupby(alike)["session"].transform(lambda x: x.index[0])
    return table


def refresh(preset, data_set, velocity, rate):
    row = session(
        f"{data_set} {velocity:g} deg/s",
        data_set,
        f"simulated {data_set}",
        preset.loc["denes2020"],
        velocity_deg_s=velocity,
        texture="checkerboard",
        mip_level=1,
        condition=f"{rate:g} Hz",
    )
    return {**row, "refresh_rate_hz": rate}


def opinion(table):
    """Quality of each condition relative to its reference. [JND]."""
    textures = builtin_textures()
    parameters = Parameters.published()
    spatial, temporal = np.zeros(len(table)), np.zeros(len(table))
    for name, rows in table.groupby("texture"):
        column = lambda key, rows=rows: rows[key].to_numpy(float)
        parts = distortion(
            Spectrum.from_texture(textures[name]),
            Display(
                ppd=column("ppd"),
                refresh_rate=column("refresh_rate_hz"),
                luminance=column("mean_luminance_cd_m2"),
                persistence=column("persistence"),
            ),
            Viewing(column("velocity_deg_s")),
            Shading(rate_x=column("rate_x"), mip_level=column("mip_level")),
            parameters,
        )
        spatial[rows.index] = parts.spatial
        temporal[rows.index] = parts.temporal
    both = float(parameters.ws) * spatial + float(parameters.wt) * temporal
    quality = np.where(table["temporal_only"], -temporal, both)
    quality = quality * table["data_set"].map(SCALES).to_numpy()
    return quality - quality[table["reference"]]


def votes(table, quality, generator):
    rows = []
    for name, members in table.groupby("session", sort=False):
        known = dict(zip(members["condition"], quality[members.index], strict=True))
        for observer in range(OBSERVERS):
            for a, b in itertools.combinations(known, 2):
                rows.append((f"s{observer:02d}", name, a, b, known[a], known[b]))
    frame = pandas.DataFrame(
        rows,
        columns=["observer", "session", "condition_a", "condition_b", "qa", "qb"],
    )
    qa, qb = frame.pop("qa").to_numpy(), frame.pop("qb").to_numpy()
    return frame.assign(a_preferred=simulate(qa, qb, generator).astype(int))


def main():
    here = Path(__file__).parent
    with jax.enable_x64(True):
        table = conditions()
        quality = opinion(table)
    cast = votes(table, quality, np.random.default_rng(SEED))
    table.assign(true_quality_jnd=quality.round(9)).to_csv(
        here / "simulated_conditions.csv", index=False
    )
    cast.to_csv(here / "simulated_votes.csv", index=False)


if __name__ == "__main__":
    main()

"""Make `example_conditions.csv` and `example_votes.csv`, an experiment of one's own.

Twenty simulated observers compare two textures at three shading rates, at two
velocities, and one texture at five refresh rates. Their opinion is the released model
with the published constants. Run as

    python data/simulate_example.py

and the two files beside this script are written anew, the same to the byte.
"""

import itertools
from pathlib import Path

import jax
import numpy as np
import pandas

from camojab import predict
from camojab.votes import simulate


SEED = 20261122
OBSERVERS = 20


def conditions():
    rows = []
    for velocity in (5.0, 20.0):
        for texture, m in itertools.product(("brick", "noise"), (1, 2, 4)):
            name, reference = f"{texture} {m}x1", f"{texture} 1x1"
            rows.append((f"{velocity:g} deg/s", name, reference, texture, m, velocity))
    for rate in (120, 90, 60, 45, 30):
        name, reference = f"{rate} Hz", "120 Hz"
        rows.append(("refresh rate", name, reference, "brick", 1, 20.0))
    session, condition, reference, texture, coarse, velocity = zip(*rows, strict=True)
    rates = [int(n.split()[0]) if n.endswith("Hz") else 120 for n in condition]
    return pandas.DataFrame(
        {
            "session": session,
            "condition": condition,
            "reference": reference,
            "texture": [f"builtin:{name}" for name in texture],
            "mean_luminance_cd_m2": 10.0,
            "refresh_rate_hz": np.array(rates, float),
            "velocity_deg_s": velocity,
            "persistence": 1.0,
            "ppd": 50.0,
            "rate_x": 1.0 / np.array(coarse),
            "rate_y": 1.0,
            "mip_level": 3,
        }
    )


def votes(table, quality, generator):
    rows = []
    for session, members in table.groupby("session", sort=False):
        known = dict(zip(members["condition"], quality[members.index], strict=True))
        base = dict(zip(members["condition"], members["reference"], strict=True))
        lost = {name: known[name] - known[base[name]] for name in known}
        for number in range(OBSERVERS):
            for a, b in itertools.combinations(known, 2):
                rows.append((f"p{number:02d}", session, a, b, lost[a], lost[b]))
    names = ["observer", "session", "condition_a", "condition_b", "qa", "qb"]
    frame = pandas.DataFrame(rows, columns=names)
    qa, qb = frame.pop("qa").to_numpy(), frame.pop("qb").to_numpy()
    return frame.assign(a_preferred=simulate(qa, qb, generator).astype(int))


def main():
    here = Path(__file__).parent
    table = conditions()
    with jax.enable_x64(True):
        quality = predict(table)["quality_jnd"].to_numpy()
    cast = votes(table, quality, np.random.default_rng(SEED))
    table.to_csv(here / "example_conditions.csv", index=False)
    cast.to_csv(here / "example_votes.csv", index=False)


if __name__ == "__main__":
    main()

"""What each difference between the paper and its program changes, in JND.

    python tests/benchmarks/differences.py

The transcription of the program is altered in one respect at a time and evaluated, with
the published constants, under the conditions of the golden table whose exponent is the
published one. The published textures are needed.
"""

import sys
from pathlib import Path

import numpy as np

from camojab import datasets


TESTS = Path(__file__).parents[1]
sys.path.insert(0, str(TESTS))
# It lies in the folder that the line above adds.
import reference  # noqa: E402


SIZE, HALF = reference.SIZE, reference.SIZE // 2


def quality(spectrum, c, *, place=2.0, radial=False, impulses=(0, 1)):
    """The program's quality with what `ALTERED` says. [JND]."""
    k = np.arange(-HALF, HALF)
    step = c["ppd"] / SIZE
    rho_x, rho_y = np.meshgrid(k * step, k * step)
    together = np.hypot if radial else np.maximum
    rho = together(np.abs(rho_x), np.abs(rho_y))
    g = spectrum
    if c["vrs"]:
        rates = c["rate_x"], c["rate_y"]
        b = 2.0 ** c["mip_level"] / (c["ppd"] * min(rates))
        g = g * reference.lorentzian(rho_x, b) * reference.lorentzian(rho_y, b)
        for axis, rate in ((1, rates[0]), (0, rates[1])):
            samples = int(SIZE * rate + 1.5)
            centre = 1 - samples % 2
            shifts = [n * (samples // 2) if n else centre for n in impulses]
            g = sum(_moved(g, by, axis) for by in shifts)
        inside = [np.abs(k) <= rate * HALF for rate in rates]
        g = g * inside[0][None, :] * inside[1][:, None]
    blur = np.ones_like(g)
    if c["eye_blur"]:
        p, v = c["persistence"], c["velocity"]
        for width in (p * v / c["refresh_rate"], p * (0.001648 * v + 0.079818)):
            blur = blur * reference.lorentzian(rho_x, width)
    still = reference.sensitivity(rho, 0.0, c["luminance"])
    beta = reference.BETA
    e_s = np.mean((spectrum * still) ** beta - (g * blur * still) ** beta)
    e_t = 0.0
    if c["judder"]:
        s = int(c["refresh_rate"] / (place * max(c["velocity"], 0.1) * step))
        flicker = reference.sensitivity(rho, c["refresh_rate"], c["luminance"])
        e_t = np.mean((_moved(g, -min(s, SIZE), 1) * flicker) ** beta)
    return reference.WS * e_s + reference.WT * e_t


def _moved(a, by, axis):
    """`a[k + by]`, zero beyond the edge."""
    out = np.zeros_like(a)
    a, view = np.moveaxis(a, axis, 0), np.moveaxis(out, axis, 0)
    if abs(by) < SIZE:
        view[max(-by, 0) : SIZE - max(by, 0)] = a[max(by, 0) : SIZE + min(by, 0)]
    return out


# Impulses of the comb in units of half its period, which is 512 r bins.
ALTERED = {
    "nothing": {},
    "temporal replica at f/v (Eq. 22), not f/(2v)": {"place": 1.0},
    "radial spatial frequency, not the larger component": {"radial": True},
    "two impulses on each side (Eq. 11), not one": {"impulses": (-4, -2, 0, 2, 4)},
    "one impulse at the comb's period, not at half of it": {"impulses": (0, 2)},
}


def main():
    rows = np.genfromtxt(
        TESTS / "golden" / "model_dst.csv",
        delimiter=",",
        names=True,
        dtype=None,
        encoding="utf-8",
    )
    rows = rows[np.abs(rows["beta"] - reference.BETA) < 1e-6]
    textures = datasets.jindal2021_textures()
    spectra = {name: reference.amplitude(textures[name]) for name in textures}
    names = {
        "refresh_rate_hz": "refresh_rate",
        "velocity_deg_s": "velocity",
        "mean_luminance_cd_m2": "luminance",
    }
    golden = reference.WS * rows["E_s"] + reference.WT * rows["E_t"]
    print(f"{len(rows)} conditions of {golden.min():.1f} to {golden.max():.1f} JND")
    for what, altered in ALTERED.items():
        moved = np.zeros(len(rows))
        for i, row in enumerate(rows):
            c = {names.get(name, name): row[name] for name in rows.dtype.names}
            moved[i] = quality(spectra[row["texture"]], c, **altered) - golden[i]
        print(
            f"{what}: median {np.median(np.abs(moved)):.2g} JND, "
            f"95 % within {np.quantile(np.abs(moved), 0.95):.2g}, "
            f"largest {moved[np.argmax(np.abs(moved))]:+.2g}",
            flush=True,
        )


if __name__ == "__main__":
    main()

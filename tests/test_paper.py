"""The paper's formulation against a direct NumPy evaluation of its equations.

The oracle adds one shifted copy of the spectrum for every pair of impulses of the comb
and integrates with the error function of SciPy; nothing is shared with the package. The
contrast sensitivity is that of `reference`, checked against the authors' program.
"""

import jax
import numpy as np
from scipy.stats import norm

import reference
from camojab import (
    Components,
    Display,
    distortion,
    Formulation,
    Parameters,
    Shading,
    Spectrum,
    Viewing,
)
from camojab._sampling import RESOLUTION


X64 = jax.config.jax_enable_x64

# Resolution of the spectrum between the bins of the transform, in bins.
SIGMA = 0.65


def lorentzian(frequency, width):
    """Eq. 6 and 7."""
    if width == 0:
        return np.ones_like(frequency)
    sigma = np.pi / (2 * width)
    return sigma**2 / (sigma**2 + 4 * frequency**2)


def between_bins(spectrum, shifts, axis):
    """The spectrum of bins -256..256, smoothed, at 0..256 plus each of the shifts."""
    bins, out = np.arange(-256, 257), np.arange(257)
    for shift in shifts:
        weights = norm.pdf(out[:, None] + shift - bins[None, :], scale=SIGMA)
        yield np.moveaxis(np.tensordot(weights, spectrum, (1, axis)), 0, axis)


def resampled(spectrum, down, right):
    """The sum of the spectrum's copies at every pair of shifts."""
    return sum(
        copy
        for rows in between_bins(spectrum, down, 0)
        for copy in between_bins(rows, right, 1)
    )


def inside(bound):
    """How much of each bin of [0, bound] counts; bin 0 is cut by the axis."""
    weight = norm.sf(np.arange(257), loc=bound, scale=SIGMA)
    weight[0] /= 2
    return weight


def paper(
    amplitude,
    *,
    luminance,
    refresh_rate,
    velocity,
    persistence,
    ppd,
    rate_x=1.0,
    rate_y=1.0,
    mip_level=0.0,
    beta=reference.BETA,
    ca=0.001648,
    cb=0.079818,
    vrs=True,
    eye_blur=True,
    judder=True,
):
    """d_s and d_t of Eq. 21 and 23, and the energy of the reference."""
    whole = np.empty((513, 513))
    whole[:512, :512] = amplitude
    whole[512], whole[:, 512] = whole[0], whole[:, 0]  # bin 256 is bin -256
    original = resampled(whole, [0.0], [0.0])

    coarse, crop_x, crop_y = original, 256.0, 256.0
    if vrs:
        crop_x, crop_y = 256 * rate_x, 256 * rate_y
        texel = np.arange(-256, 257) / 512
        mip = lorentzian(texel, 2.0**mip_level / min(rate_x, rate_y))  # Eq. 4 to 9
        filtered = whole * mip[:, None] * mip[None, :]
        impulses = np.arange(-2, 3) * 512  # Eq. 11 and 12, two on each side
        coarse = resampled(filtered, impulses * rate_y, impulses * rate_x)

    step = ppd / 512
    rho = np.arange(257) * step
    seen = coarse
    if eye_blur:
        hold = velocity * persistence / refresh_rate  # Eq. 14
        pursuit = (ca * velocity + cb) * persistence  # Eq. 15
        seen = coarse * (lorentzian(rho, hold) * lorentzian(rho, pursuit))[None, :]

    radius = np.sqrt(rho[None, :] ** 2 + rho[:, None] ** 2)
    still = reference.sensitivity(radius, 0.0, luminance)
    full = inside(256.0)
    area = np.outer(full, full)
    crop = np.outer(inside(crop_y), inside(crop_x))
    energy = step**2 * np.sum((original * still) ** beta * area)  # Eq. 19, 20
    left = step**2 * np.sum((seen * still) ** beta * crop)

    d_t = 0.0
    if judder:
        # Eq. 22 and 23 with rho_x + rho_A for rho_x. Beyond 2 ppd nothing is left.
        rho_a = min(refresh_rate / velocity, 2 * ppd) if velocity > 0 else 2 * ppd
        away = rho[None, :] - rho_a
        radius = np.sqrt(away**2 + rho[:, None] ** 2 + (step / 2) ** 2)
        flicker = reference.sensitivity(radius, refresh_rate, luminance)
        behind = norm.sf(np.arange(257), loc=rho_a / step, scale=SIGMA)
        along = norm.sf(np.arange(257), loc=crop_x, scale=SIGMA) * (1 - behind)
        weight = np.outer(inside(crop_y), along)
        d_t = step**2 * np.sum((coarse * flicker) ** beta * weight)
    return energy - left, d_t, energy


def textures():
    random = np.random.default_rng(3)
    index = np.arange(512) // 16
    return {
        "dense": random.random((512, 512)),
        "checkerboard": 0.15 + 0.7 * ((index[:, None] + index[None, :]) % 2),
        "ramp": np.tile(np.linspace(0.05, 0.95, 512), (512, 1)),
        "small": random.random((70, 200)),
    }


PC = {
    "luminance": 150.0,
    "refresh_rate": 144.0,
    "velocity": 28.0,
    "persistence": 1.0,
    "ppd": 50.0,
}
VR = {
    "luminance": 2.5,
    "refresh_rate": 144.0,
    "velocity": 73.0,
    "persistence": 0.05,
    "ppd": 26.0,
}
CONDITIONS = [
    ("dense", PC),
    ("dense", PC | {"rate_x": 0.5, "rate_y": 0.25, "mip_level": 1.0}),
    ("dense", PC | {"rate_x": 0.37, "rate_y": 0.81, "velocity": 40.3, "beta": 0.7}),
    ("checkerboard", PC | {"rate_x": 0.25, "rate_y": 0.5, "mip_level": 3.0}),
    ("checkerboard", PC | {"rate_x": 0.5, "velocity": 0.0}),
    ("checkerboard", VR | {"rate_x": 0.5, "rate_y": 0.5, "ca": 0.0, "cb": 0.0}),
    ("ramp", VR | {"rate_x": 0.7, "rate_y": 0.3, "mip_level": 0.4, "beta": 1.0}),
    ("small", VR | {"refresh_rate": 30.0, "judder": False, "vrs": False}),
    ("small", PC | {"velocity": 70.0, "rate_x": 0.5, "eye_blur": False}),
]


def test_like_a_direct_evaluation():
    assert RESOLUTION == SIGMA
    drawn = {name: Spectrum.from_texture(t) for name, t in textures().items()}
    spectra = {name: np.asarray(s.amplitude, float) for name, s in drawn.items()}
    fitted = {"ws": reference.WS, "wt": reference.WT, "beta": reference.BETA}
    for name, c in CONDITIONS:
        spatial, temporal, energy = paper(spectra[name], **c)
        pick = lambda *names, c=c: {n: c[n] for n in names if n in c}
        ours = distortion(
            drawn[name],
            Display(**pick("ppd", "refresh_rate", "luminance", "persistence")),
            Viewing(c["velocity"]),
            Shading(**pick("rate_x", "rate_y", "mip_level")),
            Parameters(**fitted | pick("beta", "ca", "cb")),
            formulation=Formulation.PAPER,
            components=Components(**pick("vrs", "eye_blur", "judder")),
        )
        # The spatial distortion is a difference of energies and errs in proportion.
        np.testing.assert_allclose(
            ours.spatial, spatial, rtol=0, atol=(1e-12 if X64 else 1e-5) * energy
        )
        np.testing.assert_allclose(
            ours.temporal, temporal, rtol=1e-12 if X64 else 1e-4, atol=1e-30
        )

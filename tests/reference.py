"""The released formulation transcribed line by line into NumPy.

Slow and plain on purpose: it shares no code with the package and is checked against
the numbers of the authors' program, so it can stand in for them on any other input.
"""

import math

import numpy as np


SIZE = 512
WS, WT, BETA = -3.6985309, -2.9068193, 0.3596635

_XYZ_TO_LMS = np.array(
    [
        [0.187596268556126, 0.585168649077728, -0.026384263306304],
        [-0.133397430663221, 0.405505777260049, 0.034502127690364],
        [0.000244379021663, -0.000542995890619, 0.019406849066323],
    ]
)
_D65 = np.array([0.9504, 1.0, 1.0888])
_DELTA = np.array([0.698, 0.302, 0.019613])
_MECHANISMS = np.array(
    [
        [1.0, 0.210461, 6.43059e-7],
        [1.0, -0.936788, 0.00631996],
        [-0.00135758, -1.13497, 1.0],
    ]
)
_S_MAX = [
    (346170.0, 5.64888, 0.319293, 1.8663e6, 7.57549e-5),
    (439.738, 22.4193, 0.479041),
    (11867.2, 253.395, 0.33456),
]
_F_MAX = [(2.12365, 2289.53, 0.186249), (0.119941,), (7.74728e-8,)]
_BANDWIDTH = [1.09076, 2.70798, 5.33398]
_GAMMA = [1.11387, 1.73378, 1.47414]
_A_C = [52.3184, 1.25741, 0.28267]


def _luminance_dependence(p, luminance):
    value = p[0]
    if len(p) >= 3:
        value = value * (1 + p[1] / luminance) ** -p[2]
    if len(p) == 5:
        value = value * (1 - (1 + p[3] / luminance) ** -p[4])
    return value


def spatiochromatic(rho, luminance):
    """Sensitivity without flicker. `rho` > 0 [cycles/deg], `luminance` [cd/m2]."""
    area = math.pi / 25
    background = _XYZ_TO_LMS @ (luminance * _D65)
    adapting = background[0] + background[1]
    responses = np.abs(_MECHANISMS @ (_DELTA / background))
    energy = np.zeros_like(rho)
    for i in range(3):
        s_max = _luminance_dependence(_S_MAX[i], adapting)
        f_max = _luminance_dependence(_F_MAX[i], adapting)
        s = s_max * 10 ** (
            -((np.log10(rho) - np.log10(f_max)) ** 2) / (0.5 * 2 ** _BANDWIDTH[i])
        )
        if i > 0:
            s = np.where(rho < f_max, s_max, s)
        k = _A_C[i] + 0.65 * area
        pooled = area ** _GAMMA[i] * rho**2
        s = s * np.sqrt(pooled / (k + pooled))
        energy = energy + (responses[i] * s) ** 2
    threshold = _DELTA[:, None] / np.sqrt(energy)[None, :]
    return math.sqrt(3) / np.linalg.norm(threshold / background[:, None], axis=0)


def spatiovelocity(rho, f):
    u = np.maximum(f / rho, 0.3)
    k = 6.1 + 7.3 * np.abs(np.log10(0.7986 * u / 3)) ** 3
    r_max = 45.9 / (0.7986 * u + 2)
    return (
        k
        * (0.6329 * 0.8404 * 0.7986)
        * u
        * (0.8404 * 2 * np.pi * rho) ** 2
        * np.exp(-0.8404 * 4 * np.pi * rho / r_max)
    )


def sensitivity(rho, f, luminance):
    """Contrast sensitivity. Arrays of one shape; [cycles/deg], [Hz], [cd/m2]."""
    rho = np.asarray(rho, float)
    flat = np.unique(rho)
    value = np.full(flat.shape, 0.0 if f == 0 else 1.0)
    some = flat > 0
    r = flat[some]
    value[some] = spatiochromatic(r, luminance) * (
        spatiovelocity(r, f) / (spatiovelocity(r, 0.0) + 1e-5)
    )
    return value[np.searchsorted(flat, rho)]


def lorentzian(rho, width):
    if width == 0:
        return np.ones_like(rho)
    w = math.pi / (2 * width)
    return w**2 / (w**2 + 4 * rho**2)


def _round_half_up(x):
    return math.floor(x + 0.5)


def _shifted(a, by, axis):
    """`a[k + by]`, zero beyond the edge."""
    out = np.zeros_like(a)
    a, view = np.moveaxis(a, axis, 0), np.moveaxis(out, axis, 0)
    if by < SIZE:
        view[: SIZE - by] = a[by:]
    return out


def _coarse(g, rate, axis):
    n = _round_half_up(SIZE * rate + 1)
    centre = 1 if n % 2 == 0 else 0
    return _shifted(g, centre, axis) + _shifted(g, n // 2, axis)


def amplitude(texture):
    texture = np.asarray(texture, float)[:SIZE, :SIZE]
    padded = np.zeros((SIZE, SIZE))
    padded[: texture.shape[0], : texture.shape[1]] = texture
    return np.abs(np.fft.fftshift(np.fft.fft2(padded)))


def distortion(
    spectrum,
    *,
    luminance,
    refresh_rate,
    velocity,
    persistence,
    ppd,
    rate_x,
    rate_y,
    mip_level,
    beta=BETA,
    vrs=True,
    eye_blur=True,
    judder=True,
):
    """E_s and E_t of one condition; `spectrum` from `amplitude`."""
    k = np.arange(-SIZE // 2, SIZE // 2)
    step = ppd / SIZE
    rho_x, rho_y = np.meshgrid(k * step, k * step)
    rho = np.maximum(np.abs(rho_x), np.abs(rho_y))

    g = spectrum
    if vrs:
        b = 2.0**mip_level / (ppd * min(rate_x, rate_y))
        g = g * lorentzian(rho_x, b) * lorentzian(rho_y, b)
        g = _coarse(_coarse(g, rate_x, 1), rate_y, 0)
        half = SIZE // 2
        keep = (np.abs(k)[None, :] <= rate_x * half) & (
            np.abs(k)[:, None] <= rate_y * half
        )
        g = g * keep

    blur = np.ones_like(g)
    if eye_blur:
        blur = lorentzian(rho_x, persistence * velocity / refresh_rate) * lorentzian(
            rho_x, persistence * (0.001648 * velocity + 0.079818)
        )

    still = sensitivity(rho, 0.0, luminance)
    e_s = np.mean((spectrum * still) ** beta - (g * blur * still) ** beta)

    e_t = 0.0
    if judder:
        s = math.floor(refresh_rate / (2 * max(velocity, 0.1) * step))
        moved = np.zeros_like(g)
        if s < SIZE:
            moved[:, s:] = g[:, : SIZE - s]
        flicker = sensitivity(rho, refresh_rate, luminance)
        e_t = np.mean((moved * flicker) ** beta)
    return e_s, e_t

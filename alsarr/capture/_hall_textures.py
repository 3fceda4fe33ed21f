"""The textures of the procedural hall: scikit-image's pictures, and some drawn."""

import numpy as np
from jaxtyping import Float, Float32

from ._texels import linear_light


Picture = Float32[np.ndarray, "height width 3"]
Heights = Float[np.ndarray, "height width"]

PAINTINGS = (
    "astronaut",
    "chelsea",
    "coffee",
    "rocket",
    "hubble_deep_field",
    "immunohistochemistry",
    "camera",
    "coins",
    "moon",
)
PRINTS = ("text", "page")


def hall_textures(rng: np.random.Generator) -> dict[str, Picture]:
    """Every texture of the hall by name: colours in linear light, others as they are.

    All pictures are among those that come with scikit-image itself; nothing is
    downloaded. A name that ends in " normal" is a normal map (x to the right and y to
    the top of the picture), " surface" one of roughness (green) and metalness (blue).
    """
    grain = {name: _grey(name) for name in ("brick", "gravel", "grass")}
    # Courses of bricks lie; in the picture they stand.
    grain["brick"] = np.rot90(grain["brick"])
    planks, checks = _planks(rng), _checks(rng)
    return {
        "brick": _tinted(grain["brick"], (0.52, 0.25, 0.17), (0.86, 0.62, 0.50)),
        "brick normal": _normal_map(grain["brick"], 6.0),
        "brick surface": _surface(0.95 - 0.35 * grain["brick"]),
        "stone": _tinted(grain["gravel"], (0.42, 0.39, 0.34), (0.95, 0.92, 0.86)),
        "stone normal": _normal_map(grain["gravel"], 3.0),
        "marble": _marble(rng),
        "plaster": _tinted(_noise(rng, 256), (0.62, 0.58, 0.50), (0.84, 0.81, 0.74)),
        "grass": _tinted(grain["grass"], (0.12, 0.18, 0.06), (0.58, 0.66, 0.34)),
        "floor": checks,
        "floor surface": _surface(0.12 + 0.45 * _noise(rng, 512) ** 2),
        "planks": planks,
        "planks normal": _normal_map(planks.mean(axis=2), 4.0),
        "rug": _rug(rng),
        "metal surface": _surface(0.3 + 0.7 * _noise(rng, 256), metallic=1.0),
    } | {name: _coloured(name) for name in PAINTINGS + PRINTS}


def _coloured(name: str) -> Picture:
    import skimage.data

    picture = np.asarray(getattr(skimage.data, name)())
    if picture.ndim == 2:
        picture = np.repeat(picture[:, :, None], 3, axis=2)
    return linear_light(picture[:, :, :3])


def _grey(name: str) -> Heights:
    import skimage.data

    values = np.asarray(getattr(skimage.data, name)(), float)
    low, high = np.percentile(values, (0.5, 99.5))
    return np.clip((values - low) / (high - low), 0, 1)


def _tinted(
    grey: Heights,
    dark: tuple[float, float, float],
    bright: tuple[float, float, float],
) -> Picture:
    """From one sRGB colour to another, in linear light."""
    colour = np.array(dark) + grey[:, :, None] * (np.array(bright) - np.array(dark))
    return linear_light(np.asarray(np.rint(255 * colour), np.uint8))


def _normal_map(height: Heights, strength: float) -> Picture:
    """Normals of a repeating height field, 0 to 1 high; slopes times `strength`."""
    right = (np.roll(height, -1, axis=1) - np.roll(height, 1, axis=1)) / 2
    up = (np.roll(height, 1, axis=0) - np.roll(height, -1, axis=0)) / 2
    normal = np.stack([-strength * right, -strength * up, np.ones_like(right)], axis=2)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    return np.asarray(0.5 + 0.5 * normal, np.float32)


def _surface(roughness: Heights, *, metallic: float = 0.0) -> Picture:
    full = np.ones_like(roughness)
    return np.stack([full, roughness, metallic * full], axis=2).astype(np.float32)


def _noise(rng: np.random.Generator, size: int, fall: float = 1.2) -> Heights:
    """Clouds that repeat, 0 to 1: white noise, its amplitude as 1/frequency^fall."""
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :])
    frequency[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.normal(size=(size, size))) / frequency**fall
    cloud = np.fft.irfft2(spectrum, (size, size))
    return (cloud - cloud.min()) / (cloud.max() - cloud.min())


def _checks(rng: np.random.Generator) -> Picture:
    """4 x 4 marble tiles, light and dark, with joints."""
    size, tile = 512, 128
    place = np.arange(size)
    dark = (place[:, None] // tile + place[None, :] // tile) % 2 == 1
    vein = np.abs(np.sin(16 * _noise(rng, size, fall=1.8) + 2 * _noise(rng, size)))
    tone = rng.uniform(0.9, 1.0, (4, 4)).repeat(tile, 0).repeat(tile, 1)
    grey = np.where(dark, 0.14 + 0.16 * vein**6, 0.86 - 0.28 * vein**6) * tone
    joint = (place % tile < 3) | (place % tile >= tile - 2)
    grey = np.where(joint[:, None] | joint[None, :], 0.35, grey)
    return _tinted(np.clip(grey, 0, 1), (0.02, 0.02, 0.03), (0.98, 0.95, 0.88))


def _marble(rng: np.random.Generator) -> Picture:
    cloud, fine = _noise(rng, 512, fall=2.0), _noise(rng, 512)
    vein = np.abs(np.sin(22 * cloud + 2 * fine))
    grey = np.clip(0.95 - 0.6 * (1 - vein) ** 5 - 0.3 * cloud - 0.15 * fine, 0, 1)
    return _tinted(grey, (0.20, 0.22, 0.24), (1.0, 0.97, 0.92))


def _planks(rng: np.random.Generator) -> Picture:
    """Eight boards, one above the other, with grain along them."""
    size, board = 512, 64
    grain = _noise(rng, size)
    along = np.abs(np.fft.irfft2(np.fft.rfft2(grain)[:, :12], (size, size)))
    rings = 0.5 + 0.5 * np.sin(60 * grain[:, :1] + 30 * along / along.max())
    fine = (
        rng.random((size, 1)) * 0.5 + rng.random((size, size // 16)).repeat(16, 1) / 4
    )
    tone = rng.uniform(0.5, 1.0, size // board).repeat(board)[:, None]
    gap = (np.arange(size) % board < 3)[:, None]
    grey = np.where(gap, 0.0, tone * (0.45 + 0.3 * rings + 0.3 * fine))
    return _tinted(np.clip(grey, 0, 1), (0.16, 0.09, 0.05), (0.80, 0.58, 0.36))


def _rug(rng: np.random.Generator) -> Picture:
    """A fine woven pattern of four colours with a border."""
    size = 256
    y, x = np.mgrid[0:size, 0:size]
    period = rng.integers(6, 12, 2)
    diamonds = (np.abs(x % 64 - 32) + np.abs(y % 64 - 32)) // period[0] % 2
    stripes = (x // 2 + y // 2) % 2
    index = diamonds * 2 + stripes
    edge = np.minimum(np.minimum(x, y), size - 1 - np.maximum(x, y))
    index = np.where(edge < 24, edge // 4 % 4, index)
    dyes = np.array([[96, 22, 26], [214, 190, 150], [28, 36, 78], [176, 120, 40]])
    colours = np.clip(dyes + rng.integers(-20, 21, (4, 3)), 0, 255).astype(np.uint8)
    return linear_light(colours[index])

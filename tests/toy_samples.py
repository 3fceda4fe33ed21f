"""Viewpoints whose metric is a simple function of what a network is shown.

Noise of another strength in every tile; the error of a rate is the largest step between
neighbours along the axis that it halves. In some tiles the previous picture was unseen.
"""

import numpy as np

from alsarr.network import Samples


OUTPUTS = ("1x2", "2x1")


def toy_samples(views, *, rows=4, columns=6, seed=0, scene="toy"):
    random = np.random.default_rng(seed)
    shape = (views, rows, columns)
    to_pixels = lambda tiles: np.kron(tiles, np.ones((1, 16, 16)))
    texture = to_pixels(random.uniform(0, 1, shape))
    texture = texture * random.uniform(0, 1, texture.shape)
    seen = random.uniform(0, 1, shape) < 0.8
    stored = lambda x: np.rint(255 * x).astype(np.uint8)
    tiles = texture.reshape(views, rows, 16, columns, 16)
    across = np.abs(np.diff(tiles, axis=4)).max(axis=(2, 4))
    down = np.abs(np.diff(tiles, axis=2)).max(axis=(2, 4))
    return Samples(
        inputs={
            "reprojected_red": stored(texture * to_pixels(seen)),
            "seen": stored(to_pixels(seen)),
            "diffuse_red": stored(texture),
            "normal_z": np.ones(texture.shape, np.float16),
        },
        targets=np.stack([down, across], axis=1).astype(np.float32),
        seen=seen,
        names=tuple(f"{scene}{i}" for i in range(views)),
        scenes=(scene,) * views,
        outputs=OUTPUTS,
        metric="toy",
        ppd=60.0,
    )

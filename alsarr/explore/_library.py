"""Textures that the explorer offers, without ever downloading one."""

import os
from pathlib import Path

import numpy as np
from jaxtyping import Float

from camojab import datasets


# What `datasets.jindal2021_textures` reads.
_STIMULI = "jindal2021/Experiment_Data/vrs_exp_stimulus.mat"


def textures() -> dict[str, Float[np.ndarray, "512 512"]]:
    """Relative luminance by name: built-in textures, and published ones if at hand.

    Those of Jindal et al. 2021 are offered where `CAMOJAB_DATA_DIR` or the user's cache
    has them, under the names that `camojab predict` knows.
    """
    found = dict(datasets.builtin_textures())
    if _at_hand(_STIMULI):
        published = datasets.jindal2021_textures()
        found |= {f"jindal2021:{name}": image for name, image in published.items()}
    return found


def _at_hand(name: str) -> bool:
    folder = os.environ.get("CAMOJAB_DATA_DIR")
    if folder is None:
        import pooch

        folder = pooch.os_cache("camojab")
    return (Path(folder) / name).is_file()

"""The colour-science package, without what importing it changes elsewhere."""

from typing import Any

import numpy as np


def colour_science() -> Any:
    """The package, imported where it is used: that takes seconds."""
    # Its import makes NumPy print as version 1.13 did, in the whole process.
    with np.printoptions():
        import colour
    return colour

"""Make lpips_alex.npz: what the package lpips says of random weights.

    python tests/golden/lpips_make.py

where torch and lpips are installed. Tests draw the same weights and pictures from
`drawn` and need neither.
"""

import datetime
import importlib.metadata
import json
import sys
from pathlib import Path

import numpy as np


SHAPES = (
    ("net.slice1.0", (64, 3, 11, 11)),
    ("net.slice2.3", (192, 64, 5, 5)),
    ("net.slice3.6", (384, 192, 3, 3)),
    ("net.slice4.8", (256, 384, 3, 3)),
    ("net.slice5.10", (256, 256, 3, 3)),
)
SEED = 2018
SIZE = (64, 72)


def drawn():
    """Weights by the names of lpips, and two pictures in [0, 1]; float32."""
    random = np.random.default_rng(SEED)
    arrays = {}
    for layer, (name, shape) in enumerate(SHAPES):
        spread = np.sqrt(2 / np.prod(shape[1:]))
        arrays[f"{name}.weight"] = random.uniform(-2, 2, shape) * spread
        arrays[f"{name}.bias"] = random.uniform(-0.1, 0.1, shape[0])
        linear = random.uniform(0, 1, (1, shape[0], 1, 1))
        arrays[f"lin{layer}.model.1.weight"] = linear
    reference = random.uniform(0, 1, (*SIZE, 3))
    # Equal on the left, where the difference is only what the fields reach.
    test = reference.copy()
    test[:, 40:] = np.clip(test[:, 40:] + random.uniform(-0.2, 0.2, (64, 32, 3)), 0, 1)
    arrays = {name: value.astype(np.float32) for name, value in arrays.items()}
    return arrays, reference.astype(np.float32), test.astype(np.float32)


def main():
    import lpips
    import torch

    arrays, *pictures = drawn()
    found = {}
    pair = [torch.tensor(p.transpose(2, 0, 1)[None]).double() for p in pictures]
    for spatial in (True, False):
        net = lpips.LPIPS(
            pretrained=False, net="alex", pnet_rand=True, spatial=spatial, verbose=False
        )
        state = {name: torch.tensor(value) for name, value in arrays.items()}
        _, unexpected = net.load_state_dict(state, strict=False)
        assert not unexpected
        net.double()
        for normalize in (True, False):
            name = (
                f"{'map' if spatial else 'distance'}_{'not_' * (not normalize)}centred"
            )
            value = net(*pair, normalize=normalize)
            found[name] = value.detach().numpy().squeeze()
    provenance = {
        "tool": f"lpips {importlib.metadata.version('lpips')}, double precision",
        "torch": torch.__version__,
        "command": "python tests/golden/lpips_make.py",
        "python": sys.version.split()[0],
        "date": datetime.date.today().isoformat(),
        "seed": SEED,
    }
    np.savez_compressed(
        Path(__file__).with_name("lpips_alex.npz"),
        provenance=np.array(json.dumps(provenance)),
        **found,
    )


if __name__ == "__main__":
    main()

import subprocess
import sys

import numpy as np
import pytest
from skimage import data

from camojab.datasets import builtin_textures


def test_six_luminance_textures():
    textures = builtin_textures()
    assert list(textures) == [
        "brick",
        "grass",
        "gravel",
        "checkerboard",
        "noise",
        "gradient",
    ]
    for texture in textures.values():
        assert texture.shape == (512, 512) and texture.dtype == np.float64
        assert texture.min() >= 0 and texture.max() <= 1


@pytest.mark.parametrize(
    "name, contrast", [("checkerboard", 0.7), ("noise", 0.8), ("gradient", 0.9)]
)
def test_drawn_textures_have_the_contrast_of_table_3(name, contrast):
    texture = builtin_textures()[name]
    low, high = texture.min(), texture.max()
    np.testing.assert_allclose((high - low) / (high + low), contrast, rtol=1e-12)
    # A turned board does not fill the square with whole pairs of squares.
    tolerance = 0.02 if name == "checkerboard" else 1e-12
    np.testing.assert_allclose(texture.mean(), 0.5, rtol=tolerance)


def test_drawings():
    textures = builtin_textures()
    checks = textures["checkerboard"]
    assert np.ptp(checks[8:16, 12:20]) < 1e-12
    # One square along the turned axis is the opposite; two squares are the same.
    dx, dy = 32 * np.cos(np.radians(10)), 32 * np.sin(np.radians(10))
    at = lambda n: checks[round(12 + n * dy), round(16 + n * dx)]
    np.testing.assert_allclose([at(n) for n in range(4)], [0.85, 0.15, 0.85, 0.15])
    assert (np.diff(textures["gradient"], axis=1) > 0).all()
    assert (np.diff(textures["gradient"], axis=0) == 0).all()
    np.testing.assert_allclose(textures["noise"].std(), 0.1, rtol=1e-12)
    np.testing.assert_array_equal(textures["noise"], builtin_textures()["noise"])


@pytest.mark.parametrize("name", ["brick", "grass", "gravel"])
def test_photographs_are_decoded_from_srgb(name):
    code = getattr(data, name)() / 255
    # IEC 61966-2-1, written out.
    expected = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(builtin_textures()[name], expected, rtol=1e-12)


def test_arrays_print_as_before():
    # colour-science, imported for the decoding, sets how NumPy prints.
    code = (
        "import sys, numpy as np; from camojab.datasets import builtin_textures; "
        "from camojab import luminance; before = np.get_printoptions(); "
        "builtin_textures(); luminance([[0.5]], encoding='sRGB'); "
        "assert 'colour' in sys.modules and np.get_printoptions() == before"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr

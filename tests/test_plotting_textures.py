"""Pictures of textures and of their spectra hold what they are given, with units."""

import io

import jax.numpy as jnp
import matplotlib
import numpy as np
import pytest

from camojab import datasets, Spectrum
from camojab.plotting import amplitude_spectra, textures


RNG = np.random.default_rng(4)


def drawn(figure):
    """It can be saved, and its texts do not reach over the edge."""
    backend = matplotlib.get_backend()
    figure.savefig(io.BytesIO(), format="png", dpi=40)
    box = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width and box.y1 <= height
    assert matplotlib.get_backend() == backend
    return figure


@pytest.mark.parametrize("count", [1, 3, 8])
@pytest.mark.parametrize("shape", [(20, 20), (12, 30), (30, 12)])
def test_textures_are_grey_pictures_encoded_for_the_screen(count, shape):
    images = {f"texture {i}": RNG.uniform(size=shape) for i in range(count)}
    figure = drawn(textures(images))
    shown = [axis for axis in figure.axes if axis.images]
    assert [axis.get_title() for axis in shown] == list(images)
    for axis, image in zip(shown, images.values(), strict=True):
        (picture,) = axis.images
        np.testing.assert_allclose(picture.get_array(), image ** (1 / 2.2))
        # The same light has the same grey in all of them.
        assert picture.get_clim() == (0.0, 1.0)
        assert picture.get_cmap().name == "gray" and picture.origin == "upper"
        assert not axis.axison


def test_names_do_not_lie_on_pictures():
    images = {f"texture {i}": RNG.uniform(size=(9, 9)) for i in range(8)}
    figure = drawn(textures(images))
    pictures = [axis.get_window_extent() for axis in figure.axes if axis.images]
    names = [axis.title.get_window_extent() for axis in figure.axes if axis.images]
    assert not [1 for name in names for box in pictures if name.overlaps(box)]


@pytest.mark.parametrize(
    "images, sentence",
    [
        ({}, "`images` must have at least one image, got none."),
        (
            {"red": np.zeros((4, 4, 3))},
            "`images` must have shape [height, width], got [4, 4, 3] for 'red'.",
        ),
        (
            {"none": np.zeros((0, 4))},
            "`images` must have shape [height, width], got [0, 4] for 'none'.",
        ),
        (
            {"byte": np.full((2, 2), 255)},
            "`images` must be in [0, 1], got 255 for 'byte'.",
        ),
        (
            {"hole": np.full((2, 2), np.nan)},
            "`images` must be in [0, 1], got nan for 'hole'.",
        ),
    ],
)
def test_what_is_no_texture_is_a_sentence(images, sentence):
    with pytest.raises(ValueError) as raised:
        textures(images)
    assert str(raised.value) == sentence


def lines(figure):
    (axis,) = figure.axes
    return {line.get_label(): line.get_xydata() for line in axis.lines}


def test_a_spectrum_is_the_mean_over_rings():
    amplitude = RNG.uniform(1, 2, (512, 512))
    spectrum = Spectrum(jnp.asarray(amplitude, float))
    figure = drawn(amplitude_spectra({"noise": spectrum}))
    (axis,) = figure.axes
    assert axis.get_xlabel() == "spatial frequency [cycles/texel]"
    assert axis.get_ylabel() == "mean amplitude [1]"
    assert (axis.get_xscale(), axis.get_yscale()) == ("log", "log")
    frequency, mean = lines(figure)["noise"].T
    np.testing.assert_allclose(frequency, np.arange(1, 256) / 512)
    k = np.arange(-256, 256)
    distance = np.hypot(k[:, None], k[None, :])
    for ring in (1, 2, 100, 255):
        of_ring = amplitude[(distance > ring - 0.5) & (distance < ring + 0.5)]
        np.testing.assert_allclose(mean[ring - 1], of_ring.mean(), rtol=1e-6)


def test_on_a_display_frequency_is_in_cycles_per_degree():
    grass = Spectrum.from_texture(datasets.builtin_textures()["grass"])
    figure = drawn(amplitude_spectra({"grass": grass}, ppd=60.0))
    assert figure.axes[0].get_xlabel() == "spatial frequency [cycles/deg]"
    on_display, plain = (
        lines(amplitude_spectra({"grass": grass}, ppd=ppd))["grass"]
        for ppd in (60.0, None)
    )
    np.testing.assert_allclose(on_display[:, 0], 60 * plain[:, 0])
    np.testing.assert_array_equal(on_display[:, 1], plain[:, 1])


def test_a_grating_has_its_frequency_and_a_flat_texture_none():
    x = np.arange(512)
    grating = np.broadcast_to(0.5 + 0.5 * np.cos(2 * np.pi * x / 16), (512, 512))
    images = {"grating": grating, "flat": np.full((512, 512), 0.5)}
    spectra = {name: Spectrum.from_texture(image) for name, image in images.items()}
    found = lines(drawn(amplitude_spectra(spectra)))
    # Rounding is not drawn, and what is left out is not taken for more of it.
    assert found["flat"].size == 0
    np.testing.assert_allclose(found["grating"][:, 0], [1 / 16])
    drawn(amplitude_spectra({"flat": spectra["flat"]}))


def test_what_cannot_be_drawn_is_a_sentence():
    with pytest.raises(ValueError, match="^`spectra` must have at least one spectrum"):
        amplitude_spectra({})
    flat = {"flat": Spectrum.from_texture(np.full((4, 4), 0.5))}
    for ppd in (0.0, -60.0, np.inf, np.nan):
        with pytest.raises(ValueError, match="^`ppd` must be positive and finite, got"):
            amplitude_spectra(flat, ppd=ppd)

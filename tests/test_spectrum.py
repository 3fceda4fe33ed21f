import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from camojab import luminance, Spectrum


X64 = jax.config.jax_enable_x64
DTYPE = np.float64 if X64 else np.float32


def random_texture(*shape, seed=0):
    return np.random.default_rng(seed).random(shape)


def amplitude_by_numpy(texture):
    """The stated rule by other means: crop to the top left, pad right and bottom."""
    texture = np.asarray(texture, float)
    grid = np.zeros((512, 512))
    rows, columns = min(texture.shape[0], 512), min(texture.shape[1], 512)
    grid[:rows, :columns] = texture[:rows, :columns]
    return np.roll(np.abs(np.fft.fft2(grid)), (256, 256), (0, 1))


def assert_same(spectrum, expected):
    # A spectrum computed in double is exact up to the last rounding to the default.
    amplitude = np.asarray(spectrum.amplitude)
    assert amplitude.dtype == DTYPE
    scale = expected.max()
    atol = (1e-14 if X64 else 1e-7) * scale
    np.testing.assert_allclose(
        amplitude, expected, rtol=1e-12 if X64 else 1e-6, atol=atol
    )


@pytest.mark.parametrize(
    "shape",
    [(512, 512), (1, 1), (3, 700), (700, 3), (600, 900), (511, 512), (13, 1), (1, 512)],
)
def test_any_size(shape):
    texture = random_texture(*shape)
    assert_same(Spectrum.from_texture(texture), amplitude_by_numpy(texture))


def test_crop_keeps_the_top_left():
    texture = random_texture(700, 800)
    elsewhere = texture.copy()
    elsewhere[512:], elsewhere[:, 512:] = 0.5, 0.25
    np.testing.assert_array_equal(
        Spectrum.from_texture(texture).amplitude,
        Spectrum.from_texture(elsewhere).amplitude,
    )


@pytest.mark.parametrize(
    "dtype", [np.uint8, np.uint16, np.int8, np.int32, np.uint64, np.int64]
)
def test_integers_count_to_the_largest_of_their_type(dtype):
    top = np.iinfo(dtype).max
    texture = np.array([[0, top // 2], [top, top // 5]], dtype)
    assert_same(
        Spectrum.from_texture(texture),
        amplitude_by_numpy(texture.astype(float) / float(top)),
    )


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_real_values_stand_for_themselves(dtype):
    texture = random_texture(20, 30).astype(dtype)
    assert_same(Spectrum.from_texture(texture), amplitude_by_numpy(texture))


def test_booleans_and_jax_arrays():
    texture = random_texture(9, 7) > 0.5
    expected = amplitude_by_numpy(texture)
    assert_same(Spectrum.from_texture(texture), expected)
    assert_same(Spectrum.from_texture(jnp.asarray(texture)), expected)


def test_half_precision_of_machine_learning_is_a_real_type():
    texture = jnp.asarray([[0.0, 0.5], [1.0, 0.25]], jnp.bfloat16)
    expected = amplitude_by_numpy(np.array([[0.0, 0.5], [1.0, 0.25]]))
    assert_same(Spectrum.from_texture(texture), expected)


def test_frequencies_of_a_grating():
    # Eight cycles in 512 texels along x: all the energy at bins 0 and +-8 of row 0.
    x = np.arange(512)
    texture = np.tile(0.5 + 0.25 * np.cos(2 * np.pi * 8 * x / 512), (512, 1))
    amplitude = np.array(Spectrum.from_texture(texture).amplitude)
    peaks = {(256, 256): 0.5, (256, 264): 0.125, (256, 248): 0.125}
    for (row, column), mean in peaks.items():
        np.testing.assert_allclose(amplitude[row, column], mean * 512**2, rtol=1e-6)
        amplitude[row, column] = 0
    assert amplitude.max() < 1e-6


def test_empty_bins_stay_empty_in_single_precision():
    # The rounding of a single-precision transform, 1e-8 of the peak here, would become
    # 1e-3 of it by a power of 0.36, in nearly all of the 2^18 bins.
    x = np.arange(512)
    grating = 0.5 + 0.3 * np.cos(2 * np.pi * 40 * x / 512 + 1)
    texture = np.tile(grating, (512, 1))
    exact = amplitude_by_numpy(texture)
    ours = np.asarray(Spectrum.from_texture(texture).amplitude)
    empty = exact < 1e-9 * exact.max()
    assert empty.mean() > 0.99
    assert ours[empty].max() < 1e-13 * exact.max()


def test_transposed_is_the_spectrum_of_the_transposed_texture():
    texture = random_texture(40, 700)
    ours = Spectrum.from_texture(texture).transposed()
    # The two passes of the transform round in another order.
    atol = (1e-14 if X64 else 1e-7) * 512**2
    np.testing.assert_allclose(
        ours.amplitude, Spectrum.from_texture(texture.T).amplitude, rtol=0, atol=atol
    )
    np.testing.assert_array_equal(
        ours.transposed().amplitude, Spectrum.from_texture(texture).amplitude
    )


# ---- colour


def test_transparency_is_left_out():
    colour = random_texture(8, 9, 3)
    with_alpha = np.concatenate([colour, random_texture(8, 9, 1, seed=1)], axis=2)
    assert_same(
        Spectrum.from_texture(with_alpha, encoding="sRGB"),
        np.asarray(Spectrum.from_texture(colour, encoding="sRGB").amplitude),
    )


def test_colour_needs_an_encoding():
    with pytest.raises(ValueError, match="^`encoding` must be named for a colour"):
        Spectrum.from_texture(random_texture(4, 4, 3))


def test_srgb_is_decoded():
    # IEC 61966-2-1: ((0.5 + 0.055) / 1.055) ** 2.4
    grey = ((0.5 + 0.055) / 1.055) ** 2.4
    assert abs(grey - 0.2140) < 1e-4
    for texture in (np.full((2, 3), 0.5), np.full((2, 3, 3), 0.5)):
        np.testing.assert_allclose(luminance(texture, encoding="sRGB"), grey, rtol=1e-4)
    np.testing.assert_allclose(
        luminance(np.full((1, 1), 128, np.uint8), encoding="sRGB"),
        ((128 / 255 + 0.055) / 1.055) ** 2.4,
        rtol=1e-9,
    )


@pytest.mark.parametrize(
    "encoding, weights",
    [
        # IEC 61966-2-1 (ITU-R BT.709 primaries) and ITU-R BT.2020, as printed there.
        ("linear", (0.2126, 0.7152, 0.0722)),
        ("sRGB", (0.2126, 0.7152, 0.0722)),
        ("ITU-R BT.2020", (0.2627, 0.6780, 0.0593)),
    ],
)
def test_luminance_weights_of_the_channels(encoding, weights):
    channels = luminance(np.eye(3)[None], encoding=encoding)[0]
    np.testing.assert_allclose(channels, weights, atol=1e-4)
    np.testing.assert_allclose(channels.sum(), 1.0, atol=1e-9)


@pytest.mark.parametrize("encoding", ["linear", "sRGB", "Display P3", "ITU-R BT.2020"])
def test_black_and_white_of_any_type(encoding):
    for dtype, white in ((np.uint8, 255), (np.uint16, 65535), (float, 1.0), (bool, 1)):
        texture = np.array([[[0] * 3, [white] * 3]], dtype)
        np.testing.assert_allclose(
            luminance(texture, encoding=encoding), [[0, 1]], atol=1e-6
        )


def test_linear_grey_stands_for_itself():
    texture = random_texture(5, 6)
    np.testing.assert_array_equal(luminance(texture, encoding="linear"), texture)
    np.testing.assert_array_equal(
        Spectrum.from_texture(texture, encoding="linear").amplitude,
        Spectrum.from_texture(texture).amplitude,
    )


def test_light_beyond_white_is_not_cut_off_silently():
    # Sony S-Log3: code values above 0.61 stand for more than a diffuse white.
    texture = np.array([[0.7, 0.9]])
    try:
        dim, bright = luminance(texture, encoding="S-Gamut3")[0]
    except ValueError as error:
        assert "`encoding`" in str(error)
    else:
        assert dim < bright


# ---- inside JAX transformations


@pytest.mark.parametrize("shape", [(512, 512), (40, 50), (600, 13)])
def test_traced_texture_has_the_same_spectrum(shape):
    texture = jnp.asarray(random_texture(*shape), DTYPE)
    concrete = Spectrum.from_texture(texture).amplitude
    traced = jax.jit(Spectrum.from_texture)(texture).amplitude
    # The transform itself runs in JAX's default precision here.
    atol = (1e-12 if X64 else 1e-5) * concrete.max()
    np.testing.assert_allclose(traced, concrete, rtol=0, atol=atol)
    many = jax.vmap(Spectrum.from_texture)(texture[None]).amplitude
    np.testing.assert_allclose(many[0], concrete, rtol=0, atol=atol)


def test_gradient_through_the_texture_is_finite_on_empty_bins():
    texture = jnp.zeros((64, 64)).at[::2].set(1.0)
    gradient = jax.grad(lambda t: Spectrum.from_texture(t).amplitude.sum())(texture)
    assert np.isfinite(gradient).all()


@pytest.mark.float64  # central differences in float32 have two digits at best
def test_gradient_through_the_texture_is_the_slope():
    texture = jnp.asarray(random_texture(30, 40))
    weights = jnp.asarray(random_texture(512, 512, seed=1))
    along = jnp.asarray(random_texture(30, 40, seed=2)) - 0.5
    function = lambda t: (Spectrum.from_texture(t).amplitude * weights).sum()
    function = jax.jit(function)
    slope = (function(texture + 1e-6 * along) - function(texture - 1e-6 * along)) / 2e-6
    ours = (jax.grad(function)(texture) * along).sum()
    np.testing.assert_allclose(ours, slope, rtol=1e-6)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, bool])
def test_traced_integers_mean_the_same_as_concrete_ones(dtype):
    texture = (random_texture(6, 7) * 2).astype(dtype) * np.array(1, dtype)
    concrete = Spectrum.from_texture(texture).amplitude
    traced = jax.jit(Spectrum.from_texture)(jnp.asarray(texture)).amplitude
    np.testing.assert_allclose(traced, concrete, rtol=0, atol=1e-5 * concrete.max())


def test_traced_texture_is_never_silently_left_encoded():
    texture = jnp.asarray(random_texture(6, 7))
    decoded = Spectrum.from_texture(texture, encoding="sRGB").amplitude
    traced = jax.jit(lambda t: Spectrum.from_texture(t, encoding="sRGB").amplitude)
    try:
        amplitude = traced(texture)
    except ValueError as error:
        assert "`encoding`" in str(error)
    else:
        np.testing.assert_allclose(amplitude, decoded, atol=1e-5 * decoded.max())


@pytest.mark.parametrize("bad", [np.nan, np.inf, -0.5, 1.5])
def test_traced_pixels_are_checked(bad):
    texture = jnp.full((4, 4), 0.5).at[1, 2].set(bad)
    with pytest.raises(RuntimeError, match=r"`texture` must be"):
        jax.block_until_ready(eqx.filter_jit(Spectrum.from_texture)(texture))


@pytest.mark.parametrize("shape", [(7,), (2, 3, 2), (0, 4), (2, 2, 3)])
def test_traced_shapes_are_checked(shape):
    with pytest.raises(ValueError, match="^`(texture|encoding)` must "):
        eqx.filter_jit(Spectrum.from_texture)(jnp.zeros(shape))


# ---- errors

BAD = [
    (np.full((3, 3), np.nan), "`texture` must be in [0, 1], got nan."),
    (np.array([[0.0, np.inf]]), "`texture` must be in [0, 1], got inf."),
    (np.array([[0.5, -0.25]]), "`texture` must be in [0, 1], got -0.25."),
    (np.array([[0.5, 1.5]]), "`texture` must be in [0, 1], got 1.5."),
    (np.array([[0, -2]]), "`texture` must not be negative, got -2."),
    (np.zeros((0, 4)), "`texture` must have at least one texel, got [0, 4]."),
    (np.zeros((4, 0, 3)), "`texture` must have at least one texel, got [4, 0, 3]."),
    (np.ones((2, 2), complex), "`texture` must hold real numbers, got complex128."),
    *(
        (
            np.zeros(shape),
            "`texture` must have shape [height, width], [height, width, 3] or "
            f"[height, width, 4], got {list(shape)}.",
        )
        for shape in ((), (5,), (2, 2, 2), (2, 2, 5), (1, 2, 2, 3))
    ),
]


@pytest.mark.parametrize("texture, message", BAD)
def test_errors(texture, message):
    with pytest.raises(ValueError) as error:
        Spectrum.from_texture(texture)
    assert str(error.value) == message
    with pytest.raises(ValueError) as error:
        luminance(texture, encoding="linear")
    assert str(error.value) == message


def test_just_beyond_white_does_not_read_as_white():
    with pytest.raises(ValueError) as error:
        Spectrum.from_texture(np.array([[1.0000001]]))
    assert not str(error.value).endswith("got 1.")


@pytest.mark.parametrize("name", ["sRBG", "", "gamma 2.2"])
def test_unknown_encoding_is_named_beside_the_known(name):
    for shape in ((2, 2), (2, 2, 3)):
        with pytest.raises(ValueError) as error:
            Spectrum.from_texture(np.ones(shape), encoding=name)
        message = str(error.value)
        assert message.startswith("`encoding` must be 'linear' or one of ")
        assert "sRGB" in message and "Display P3" in message
        assert message.endswith(f"got {name!r}.")
        assert "\n" not in message

"""Luminance texture -> amplitude spectrum."""

import equinox as eqx
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ._colour_science import colour_science
from ._errors import check, shown


SIZE = 512


class Spectrum(eqx.Module):
    """Amplitude spectrum of a texture, at the 512 x 512 frequencies of its grid.

    Bin `k` of an axis, from -256 to 255, stands for `k / 512` cycles per texel; on a
    display of `ppd` pixels per degree, where a texel covers a pixel, for
    `k * ppd / 512` cycles per degree. Rows are vertical, columns horizontal frequency.

    **Arguments:** `amplitude`: magnitude of the discrete Fourier transform, centred,
    not normalised. [1], >= 0.
    """

    amplitude: Float[Array, "512 512"]

    @classmethod
    def from_texture(
        cls, texture: ArrayLike, *, encoding: str | None = None
    ) -> "Spectrum":
        """Spectrum of a texture of any size, cropped or padded to 512 x 512 texels.

        A larger texture keeps its top left 512 x 512 texels; a smaller one is padded
        with zeros at the right and the bottom, which adds the spectrum of that edge.
        Computed in double precision outside JAX transformations, whatever JAX's
        default, because the rounding of a single-precision transform fills the empty
        bins of a regular texture and a power below one magnifies them.

        **Arguments:**

        - `texture`: rows of texels, grey [height, width] or colour [height, width, 3];
          a fourth channel is taken for transparency and left out. Integers count from
          0 to the largest value of their type; real values are in [0, 1].
        - `encoding`: how the values stand for light, a name that `luminance` knows. A
          grey texture may leave it out and is then taken for relative luminance as it
          stands; a colour texture must name it.

        **Raises:** `ValueError` for an empty texture, a wrong shape, values that are
        not finite or not in [0, 1], a colour texture without encoding, or an unknown
        encoding.

        **Source:** Jindal et al. 2021, Eq. 3; the size is that of the released program.

        **Example:**

        >>> import numpy as np
        >>> from camojab import Spectrum
        >>> spectrum = Spectrum.from_texture(np.full((16, 32), 0.5))
        >>> spectrum.amplitude.shape
        (512, 512)
        >>> float(spectrum.amplitude[256, 256])  # the sum of all texels
        256.0
        """
        if isinstance(texture, jax.core.Tracer):
            return cls(_amplitude(_traced(texture, encoding), jnp))
        return cls(jnp.asarray(_amplitude(grey(texture, encoding), np), float))

    def transposed(self) -> "Spectrum":
        """Spectrum of the transposed texture: vertical motion, as in Eq. 28."""
        return Spectrum(self.amplitude.T)


def luminance(texture: ArrayLike, *, encoding: str) -> Float[np.ndarray, "rows cols"]:
    """Relative luminance of an image, in [0, 1], with the encoding named, not guessed.

    **Arguments:**

    - `texture`: grey [height, width] or colour [height, width, 3 or 4] (the fourth
      channel is left out), of any integer or real type as in `Spectrum.from_texture`.
    - `encoding`: `"linear"` (linear light; colour has the primaries of ITU-R BT.709)
      or the name of an RGB colour space of colour-science, such as `"sRGB"`,
      `"Display P3"` or `"ITU-R BT.2020"`, whose transfer function is undone and whose
      primaries weigh the channels.

    **Raises:** `ValueError` as `Spectrum.from_texture` does.
    """
    values, colour = _checked(texture), colour_science()
    name = "sRGB" if encoding == "linear" else encoding
    if name not in colour.RGB_COLOURSPACES:
        known = ", ".join(sorted(colour.RGB_COLOURSPACES))
        raise ValueError(
            f"`encoding` must be 'linear' or one of {known}, got {encoding!r}."
        )
    space = colour.RGB_COLOURSPACES[name]
    if encoding != "linear":
        values = np.asarray(space.cctf_decoding(values), float)
    if values.ndim == 3:
        values = values @ np.asarray(space.matrix_RGB_to_XYZ)[1]
    # Rounding of the transfer function is none of the caller's business.
    if values.max() > 1.0 + 1e-6:
        raise ValueError(
            f"`encoding` must not give more light than white, as {encoding!r} does: "
            f"got {values.max():g}."
        )
    return np.clip(values, 0.0, 1.0)


def grey(texture: ArrayLike, encoding: str | None) -> Float[np.ndarray, "rows cols"]:
    """Luminance of an image, which must be grey if its encoding is not named."""
    if encoding is not None:
        return luminance(texture, encoding=encoding)
    values = _checked(texture)
    if values.ndim == 3:
        raise ValueError(
            "`encoding` must be named for a colour texture ('sRGB', 'linear', ...), "
            "got None."
        )
    return values


def _traced(texture: Array, encoding: str | None) -> Float[Array, "rows cols"]:
    """The rules of `_checked` for a texture inside a JAX transformation."""
    if encoding is not None:
        raise ValueError(
            "`encoding` must be left out under a JAX transformation (decode with "
            f"`luminance` before), got {encoding!r}."
        )
    if texture.ndim == 3 and texture.shape[2] in (3, 4):
        raise ValueError("`encoding` must be named for a colour texture, got None.")
    _check_shape(texture.shape)
    if jnp.issubdtype(texture.dtype, jnp.integer):
        texture = texture / jnp.iinfo(texture.dtype).max
    values = texture.astype(jnp.result_type(float))
    return check("texture", values, lambda x: (x >= 0) & (x <= 1), "in [0, 1]")


def _check_shape(shape: tuple[int, ...]) -> None:
    if len(shape) != 2 and not (len(shape) == 3 and shape[2] in (3, 4)):
        raise ValueError(
            "`texture` must have shape [height, width], [height, width, 3] or "
            f"[height, width, 4], got {list(shape)}."
        )
    if 0 in shape:
        raise ValueError(f"`texture` must have at least one texel, got {list(shape)}.")


def _checked(texture: ArrayLike) -> Float[np.ndarray, "..."]:
    """Values in [0, 1], transparency left out."""
    array = np.asarray(texture)
    _check_shape(array.shape)
    if array.ndim == 3:
        array = array[..., :3]
    if array.dtype == bool:
        return array.astype(float)
    if np.issubdtype(array.dtype, np.integer):
        low = np.min(array)
        if low < 0:
            raise ValueError(f"`texture` must not be negative, got {low}.")
        return array / np.iinfo(array.dtype).max
    if not jnp.issubdtype(array.dtype, jnp.floating):
        raise ValueError(f"`texture` must hold real numbers, got {array.dtype}.")
    values = array.astype(float)
    bad = ~((values >= 0) & (values <= 1))
    if bad.any():
        raise ValueError(f"`texture` must be in [0, 1], got {shown(values[bad][0])}.")
    return values


def _amplitude(texture, xp):
    """Centred magnitude of the 512 x 512 transform, in the array library `xp`."""
    texture = texture[:SIZE, :SIZE]
    rows, columns = texture.shape
    padded = xp.pad(texture, ((0, SIZE - rows), (0, SIZE - columns)))
    return xp.abs(xp.fft.fftshift(xp.fft.fft2(padded)))

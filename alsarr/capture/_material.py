"""What a point of a surface is made of: textures, and the level they are read at."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Float32, Int

from ._interpolate import bent, once, Surface, unit
from ._scene import Scene
from ._texels import Texels


# Reflectance at normal incidence of what is no metal (glTF 2.0, Appendix B).
_DIELECTRIC = 0.04


class Reflectance(eqx.Module, strict=True):
    """How points of surfaces reflect light. Linear, and 1 is all of it.

    - `diffuse`: albedo. In [0, 1]
    - `specular`: reflectance at normal incidence. In [0, 1]
    - `roughness`: perceptual; GGX's alpha is its square. In [0, 1]
    - `emissive`: radiance given off. >= 0
    - `normal`: of the surface with its normal texture. Unit.
    - `mip_level`: that the colour texture was read at. [octaves], >= 0
    """

    diffuse: Float32[Array, "3 n"]
    specular: Float32[Array, "3 n"]
    roughness: Float32[Array, " n"]
    emissive: Float32[Array, "3 n"]
    normal: Float32[Array, "3 n"]
    mip_level: Float32[Array, " n"]


def reflectance(scene: Scene, at: Surface) -> Reflectance:
    """Read the materials and textures of points."""
    materials, texels = scene.materials, scene.texels
    index = scene.material[jnp.maximum(at.triangle, 0)]
    kinds = ("colour_texture", "surface_texture", "normal_texture")
    textures = jnp.stack([getattr(materials, kind)[index] for kind in kinds])
    # A loop is compiled once for all three.
    values, levels = jax.lax.map(lambda t: _read(texels, t, at), textures)
    colour, made_of, bump = values
    base = materials.base_colour[index].T * colour
    metallic = (materials.metallic[index] * made_of[2])[None]
    return Reflectance(
        diffuse=base * (1 - metallic),
        specular=_DIELECTRIC * (1 - metallic) + base * metallic,
        roughness=materials.roughness[index] * made_of[1],
        emissive=materials.emissive[index].T,
        normal=_bumped(at, bump),
        mip_level=levels[0],
    )


def _read(
    texels: Texels, texture: Int[Array, " n"], at: Surface
) -> tuple[Float[Array, "3 n"], Float[Array, " n"]]:
    """Values of a texture at its level, and that level."""

    def look() -> tuple[Float[Array, "3 n"], Float[Array, " n"]]:
        level = mip_level(texels, texture, at.footprint_x, at.footprint_y)
        return lookup(texels, texture, at.uv, level), level

    def plain() -> tuple[Float[Array, "3 n"], Float[Array, " n"]]:
        first = texels.offset[texture, 0]
        return texels.texel[first].T, jnp.zeros(texture.shape, jnp.float32)

    # Most scenes have few textures other than of colour; white ones are one texel.
    return jax.lax.cond(jnp.any(texels.levels[texture] > 1), look, plain)


def mip_level(
    texels: Texels,
    texture: Int[Array, " n"],
    footprint_x: Float[Array, "2 n"],
    footprint_y: Float[Array, "2 n"],
) -> Float[Array, " n"]:
    """Level at which a texel is as long as the longer side of a footprint.

    **Arguments:**

    - `footprint_x`, `footprint_y`: sides of the footprint in uv. [1]

    **Returns:** [octaves], from 0 to the texture's last level.

    **Source:** Williams (1983), Pyramidal Parametrics, SIGGRAPH; as the OpenGL 4.6
    specification, Eq. 8.4 to 8.8, without anisotropy.
    """
    size = jnp.stack([texels.width[texture, 0], texels.height[texture, 0]])
    size = size.astype(jnp.float32)
    square = lambda side: jnp.sum((side * size) ** 2, axis=0)
    longer = jnp.maximum(square(footprint_x), square(footprint_y))
    level = 0.5 * jnp.log2(jnp.maximum(longer, 1.0))
    last = (texels.levels[texture] - 1).astype(jnp.float32)
    return jnp.minimum(level, last)


def lookup(
    texels: Texels,
    texture: Int[Array, " n"],
    uv: Float[Array, "2 n"],
    level: Float[Array, " n"],
) -> Float[Array, "3 n"]:
    """Trilinear values of textures, which repeat.

    **Arguments:**

    - `uv`: u to the right and v down; the centre of the first texel is half a texel
        from (0, 0). [1]
    - `level`: [octaves], from 0 to the texture's last level.
    """
    fine = jnp.floor(level).astype(jnp.int32)
    coarse = jnp.minimum(fine + 1, texels.levels[texture] - 1)
    share = (level - jnp.floor(level))[None]
    # Whole turns are taken off first: large numbers have no digits left for a texel.
    uv = uv - jnp.floor(uv)
    near = _bilinear(texels, texture, uv, fine)
    return near + share * (_bilinear(texels, texture, uv, coarse) - near)


def _bilinear(
    texels: Texels,
    texture: Int[Array, " n"],
    uv: Float[Array, "2 n"],
    level: Int[Array, " n"],
) -> Float[Array, "3 n"]:
    width, height = texels.width[texture, level], texels.height[texture, level]
    left, right, across = _neighbours(uv[0], width)
    above, below, down = _neighbours(uv[1], height)
    start = texels.offset[texture, level]
    axis = jnp.arange(3, dtype=jnp.int32)[:, None]
    texel = lambda x, y: once(texels.texel[(start + y * width + x)[None], axis])
    left, right, above, below, start = once((left, right, above, below, start))
    row = lambda y: texel(left, y) * (1 - across) + texel(right, y) * across
    return row(above) * (1 - down) + row(below) * down


def _neighbours(
    place: Float[Array, " n"], size: Int[Array, " n"]
) -> tuple[Int[Array, " n"], Int[Array, " n"], Float[Array, "1 n"]]:
    """The texels on both sides of a place, and the share of the second."""
    texel = place * size.astype(jnp.float32) - 0.5
    first = jnp.floor(texel)
    index = first.astype(jnp.int32)
    share = (texel - first)[None]
    return index % size, (index + 1) % size, share


def _bumped(at: Surface, bump: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
    """The normal that a normal texture stands for, never away from the viewer."""
    x, y, z = (2 * bump - 1)[:, None]
    normal = unit(x * at.tangent + y * at.bitangent + z * at.normal)
    return bent(normal, at.direction)

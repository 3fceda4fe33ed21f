"""A hall to walk about in, built from a seed."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ._animation import Animation
from ._hall_textures import hall_textures, PAINTINGS, PRINTS
from ._scene import Lights, Material, Mesh, Scene
from ._shapes import (
    ball,
    box,
    joined,
    lathe,
    patch,
    picture,
    quad,
    ring,
    Shape,
    waves,
)
from ._texels import Texels


_HALF_WIDTH, _HALF_LENGTH, _AISLE_HEIGHT, _VAULT_HEIGHT = 8.0, 14.0, 6.4, 9.2
_NAVE, _BAY, _COLUMNS, _SPRING = 3.6, 4.0, 6, 3.9
_WINDOW_WIDTH, _WINDOW_LOW, _WINDOW_HIGH, _WALL = 1.7, 1.5, 4.9, 0.45
_PART_LAMP, _PART_STATUE, _PART_CRATE = 1, 2, 3
# What the shapes below amount to at full detail, counted.
_TRIANGLES_AT_FULL_DETAIL = 520_000


def hall(seed: int = 0, *, triangles: int = 400_000, animated: bool = False) -> Scene:
    """A vaulted hall with columns, arches, statues, stairs, crates and lamps.

    It is 16 m wide, 28 m long and 9 m high. The sun falls in through barred windows on
    one side; lamps hang in the nave. Walls are of brick and plaster with pictures and
    prints on them, the floor of polished tiles of uneven gloss with rugs, statues are
    bumpy, and balls, rings and vases are of metals from mirror-like to matt. Textures
    have 100 to 700 texels a metre, so that at 640x368 pixels mip levels 0 to 4 occur.
    The same arguments give the same hall.

    **Arguments:**

    - `seed`: of NumPy's default generator: shapes, places, colours and the sun. >= 0.
    - `triangles`: about how many there shall be; columns, statues and other curved
        things become finer or coarser. From 20 000 to 5 000 000.
    - `animated`: one lamp swings, one statue turns and one crate slides, all with a
        period of 8 s; else everything stands still.

    **Returns:** the scene, with walls that bound where viewpoints may be. Its textures
    are those that come with scikit-image; nothing is downloaded.

    **Raises:** `ValueError` for a number out of range.
    """
    if seed < 0:
        raise ValueError(f"`seed` must be >= 0, got {seed}.")
    if not 20_000 <= triangles <= 5_000_000:
        raise ValueError(f"`triangles` must be in [20000, 5000000], got {triangles}.")
    rng = np.random.default_rng(seed)
    textures = hall_textures(rng)
    palette = _Palette(list(textures))
    detail = _Detail((triangles / _TRIANGLES_AT_FULL_DETAIL) ** 0.5)
    parts = (_PART_LAMP, _PART_STATUE, _PART_CRATE) if animated else (0, 0, 0)
    lamps = _lamps(rng)
    meshes = [
        *_shell(palette),
        *_arcade(palette, detail, rng),
        *_dais(palette, detail, rng, part=parts[1]),
        *_wall_pictures(palette, rng),
        *_rugs(palette, rng),
        *_crates(palette, detail, rng, part=parts[2]),
        *_metals(palette, detail, rng),
        *_lamp_meshes(palette, detail, lamps, part=parts[0]),
    ]
    return Scene.of(
        f"hall {seed}",
        meshes,
        palette.materials,
        textures,
        lights=_lights(rng, lamps),
        start=(0.0, 1.7, 4.0),
        bounds=_bounds(),
        animation=_animation(lamps) if animated else None,
    )


class _Palette:
    """Materials by name, numbered as they are first used."""

    def __init__(self, textures: list[str]):
        self._texture = {name: i + Texels.FIRST for i, name in enumerate(textures)}
        self._number: dict[Material, int] = {}

    def __call__(
        self,
        name: str = "",
        *,
        colour: tuple[float, float, float] = (1.0, 1.0, 1.0),
        roughness: float = 1.0,
        metallic: float = 0.0,
        emissive: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> int:
        """The number of a material with the textures of this name that there are."""
        material = Material(
            base_colour=colour,
            metallic=metallic,
            roughness=roughness,
            emissive=emissive,
            colour_texture=self._texture.get(name, Texels.WHITE),
            surface_texture=self._texture.get(f"{name} surface", Texels.WHITE),
            normal_texture=self._texture.get(f"{name} normal", Texels.FLAT),
        )
        return self._number.setdefault(material, len(self._number))

    @property
    def materials(self) -> list[Material]:
        return list(self._number)


class _Detail(NamedTuple):
    """How finely curved things are cut, relative to full detail."""

    scale: float

    def __call__(self, segments: int, least: int = 6) -> int:
        return max(least, round(segments * self.scale))


class _Lamp(NamedTuple):
    place: tuple[float, float, float]
    light: tuple[float, float, float]


def _bounds() -> np.ndarray:
    """Between knee and arch: what is above is seen but not visited."""
    x, z = _HALF_WIDTH, _HALF_LENGTH
    return np.array([[-x, 0.4, -z], [x, _SPRING + 0.5, z]])


def _column_places() -> list[float]:
    return [(i - (_COLUMNS - 1) / 2) * _BAY for i in range(_COLUMNS)]


def _bays() -> list[float]:
    """Middles between two columns."""
    return [z + _BAY / 2 for z in _column_places()[:-1]]


def _shell(palette: _Palette) -> list[Mesh]:
    """Floor, walls with windows, ceilings, and the ground outside."""
    wide, long = 2 * _HALF_WIDTH, 2 * _HALF_LENGTH
    floor = quad((-_HALF_WIDTH, 0, _HALF_LENGTH), (wide, 0, 0), (0, 0, -long))
    ground = quad((-60, -0.4, 60), (120, 0, 0), (0, 0, -120))
    brick, plaster = palette("brick"), palette("plaster", roughness=0.9)
    meshes = [
        floor.mesh(palette("floor"), repeats=0.5),
        ground.mesh(palette("grass", roughness=0.95), repeats=0.4),
        joined([_side_wall(1), _side_wall(-1)]).mesh(brick, repeats=0.5),
        joined([_end_wall(1), _end_wall(-1)]).mesh(plaster, repeats=0.5),
        joined([_vault(), _aisle_ceiling(1), _aisle_ceiling(-1)]).mesh(
            palette("planks", roughness=0.7), repeats=0.4
        ),
    ]
    bars = [_window_bars(side, z) for side in (1, -1) for z in _bays()]
    iron = palette(colour=(0.12, 0.12, 0.13), roughness=0.5, metallic=1.0)
    return [*meshes, joined(bars).mesh(iron)]


def _side_wall(side: int) -> Shape:
    """The wall at x = side * half width, with a window in every bay."""
    cuts = [-_HALF_LENGTH]
    for z in _bays():
        cuts += [z - _WINDOW_WIDTH / 2, z + _WINDOW_WIDTH / 2]
    cuts += [_HALF_LENGTH]
    floors = [-0.4, _WINDOW_LOW, _WINDOW_HIGH, _AISLE_HEIGHT]
    shapes = []
    for i, (left, right) in enumerate(zip(cuts[:-1], cuts[1:], strict=True)):
        for j, (low, high) in enumerate(zip(floors[:-1], floors[1:], strict=True)):
            shapes += (
                _reveal(left, right, low, high)
                if i % 2 == 1 and j == 1
                else [_facing_in(left, right, low, high)]
            )
    # Built for the wall at +x; the other is the same, turned half about the middle.
    return joined(shapes).moved((0, 0, 0), 0.0 if side > 0 else np.pi)


def _facing_in(left: float, right: float, low: float, high: float) -> Shape:
    x = _HALF_WIDTH
    wall = quad((x, low, left), (0, 0, right - left), (0, high - low, 0))
    return wall._replace(uv=wall.uv + np.array([left, -low], np.float32))


def _reveal(left: float, right: float, low: float, high: float) -> list[Shape]:
    x, deep = _HALF_WIDTH, _WALL
    long, tall = right - left, high - low
    return [
        quad((x, low, left), (0, 0, long), (deep, 0, 0)),
        quad((x + deep, high, left), (0, 0, long), (-deep, 0, 0)),
        quad((x + deep, low, left), (-deep, 0, 0), (0, tall, 0)),
        quad((x, low, right), (deep, 0, 0), (0, tall, 0)),
    ]


def _window_bars(side: int, z: float) -> Shape:
    x, tall = side * (_HALF_WIDTH + 0.25), _WINDOW_HIGH - _WINDOW_LOW
    upright = [
        box((0.05, tall, 0.05)).moved((x, _WINDOW_LOW, z + dz))
        for dz in np.linspace(-_WINDOW_WIDTH / 2, _WINDOW_WIDTH / 2, 6)[1:-1]
    ]
    across = [
        box((0.04, 0.04, _WINDOW_WIDTH)).moved((x, y, z))
        for y in np.linspace(_WINDOW_LOW, _WINDOW_HIGH, 7)[1:-1]
    ]
    return joined(upright + across)


def _end_wall(side: int) -> Shape:
    wide = 2 * _HALF_WIDTH
    wall = quad(
        (-_HALF_WIDTH, -0.4, -_HALF_LENGTH), (wide, 0, 0), (0, _VAULT_HEIGHT + 0.6, 0)
    )
    return wall.moved((0, 0, 0), 0.0 if side < 0 else np.pi)


def _vault() -> Shape:
    """Half an elliptic cylinder over the nave, seen from below."""
    angle = np.linspace(0, np.pi, 49)
    rise = _VAULT_HEIGHT - _AISLE_HEIGHT
    x, y = _NAVE * np.cos(angle), _AISLE_HEIGHT + rise * np.sin(angle)
    arc = np.concatenate([[0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    z = np.linspace(-_HALF_LENGTH, _HALF_LENGTH, 15)
    # Rows follow the arc from +x, columns run along the hall.
    point = np.empty((len(angle), len(z), 3))
    point[..., 0], point[..., 1], point[..., 2] = x[:, None], y[:, None], z[None, :]
    u, v = np.broadcast_arrays(z[None, :], -arc[:, None])
    return patch(point, np.stack([u, v], axis=2))


def _aisle_ceiling(side: int) -> Shape:
    wide = _HALF_WIDTH - _NAVE
    ceiling = quad(
        (_HALF_WIDTH, _AISLE_HEIGHT, -_HALF_LENGTH),
        (0, 0, 2 * _HALF_LENGTH),
        (-wide, 0, 0),
    )
    return ceiling.moved((0, 0, 0), 0.0 if side > 0 else np.pi)


def _arcade(palette: _Palette, detail: _Detail, rng: np.random.Generator) -> list[Mesh]:
    """Two rows of fluted columns with arches and the walls above them."""
    marble = palette("marble", roughness=0.35)
    column = _column(detail, waves(rng, size=0.5, depth=0.006, octaves=3))
    columns = [
        column.moved((side * _NAVE, 0, z), rng.uniform(0, 2 * np.pi)).mesh(marble)
        for side in (-1, 1)
        for z in _column_places()
    ]
    arches = joined(
        [
            face.moved((0, 0, 0), turn)
            for z in _bays()
            for turn in (0.0, np.pi)
            for face in _arch(z, detail(40, 12))
        ]
        + [
            face.moved((0, 0, 0), turn)
            for turn in (0.0, np.pi)
            for face in _wall_ends()
        ]
    )
    return [*columns, arches.mesh(palette("brick"), repeats=0.5)]


def _column(detail: _Detail, bumps: Callable[[np.ndarray], np.ndarray]) -> Shape:
    """A fluted shaft between a base and a capital, from the floor to the spring."""
    around = detail(120, 16)
    angle = np.linspace(0, 2 * np.pi, around + 1)
    height = np.unique(
        np.concatenate(
            [
                np.linspace(0, 0.5, detail(18, 5)),
                np.linspace(0.5, _SPRING - 0.5, detail(44, 6)),
                np.linspace(_SPRING - 0.5, _SPRING, detail(18, 5)),
            ]
        )
    )
    end = np.minimum(height, _SPRING - height)
    flare = 0.12 * np.clip(1 - end / 0.45, 0, 1) ** 0.5
    rounds = 0.02 * np.cos(2 * np.pi * end / 0.15) * (end < 0.45)
    flute = 0.025 * np.clip((end - 0.5) / 0.1, 0, 1)
    radius = 0.36 + flare + rounds - 0.01 * height / _SPRING
    fluted = radius[:, None] - flute[:, None] * np.abs(np.cos(8 * angle))[None, :]
    return lathe(height, fluted, around, bumps=bumps, repeats=2)


def _arch(z: float, segments: int) -> list[Shape]:
    """The arch between two columns at x = nave: two faces up to the vault, a soffit."""
    angle = np.linspace(0, np.pi, segments + 1)
    half, thick = _BAY / 2 - 0.3, 0.3
    along = np.concatenate([[-_BAY / 2], -half * np.cos(angle), [_BAY / 2]])
    arc = np.concatenate([[_SPRING], _SPRING + half * np.sin(angle), [_SPRING]])
    shapes = []
    for x, way in ((_NAVE - thick, 1), (_NAVE + thick, -1)):
        point = np.empty((2, len(along), 3))
        point[..., 0], point[..., 2] = x, z + along
        point[0, :, 1], point[1, :, 1] = arc, _AISLE_HEIGHT
        point = point[:, ::way]
        shapes.append(patch(point, np.stack([point[..., 2], -point[..., 1]], axis=2)))
    inner = np.empty((2, len(angle), 3))
    inner[..., 1], inner[..., 2] = arc[1:-1], z + along[1:-1]
    inner[0, :, 0], inner[1, :, 0] = _NAVE - thick, _NAVE + thick
    length = np.broadcast_to(half * angle, inner.shape[:2])
    soffit = patch(inner[::-1], np.stack([length, inner[..., 0]], axis=2))
    return [*shapes, soffit]


def _wall_ends() -> list[Shape]:
    """From the outermost columns at x = nave to the end walls."""
    last = _column_places()[-1]
    return [
        box((0.6, _AISLE_HEIGHT, _HALF_LENGTH - last - 0.2)).moved(
            (_NAVE, 0, side * (last + 0.2 + _HALF_LENGTH) / 2)
        )
        for side in (-1, 1)
    ]


def _dais(
    palette: _Palette, detail: _Detail, rng: np.random.Generator, *, part: int
) -> list[Mesh]:
    """Stairs to a platform at the far end, a statue on it, and a balustrade."""
    stone = palette("stone", colour=(0.9, 0.88, 0.85), roughness=0.6)
    steps = [
        box((6.4, 0.16 * (i + 1), 0.34)).moved((0, 0, -9.2 - 0.34 * i))
        for i in range(6)
    ]
    top = box((6.4, 0.96, _HALF_LENGTH - 11.07)).moved((0, 0, -11.07 / 2 - 7))
    pedestal = box((1.1, 0.9, 1.1)).moved((0, 0.96, -12.6))
    rail = [box((1.9, 0.08, 0.16)).moved((x, 1.75, -11.3)) for x in (-2.2, 2.2)]
    bumps = waves(rng, size=0.1, depth=0.002, octaves=2)
    baluster = _baluster(detail, bumps)
    balusters = [
        baluster.moved((sign * x, 0.96, -11.3))
        for sign in (-1, 1)
        for x in np.linspace(1.35, 3.05, 9)
    ]
    figure = _figure(detail, rng, 1.9).moved((0, 1.86, -12.6))
    return [
        joined(steps + [top, pedestal]).mesh(stone, repeats=0.5),
        joined(rail + balusters).mesh(palette("plaster", roughness=0.5)),
        figure.mesh(
            palette(colour=(0.72, 0.45, 0.2), roughness=0.35, metallic=1.0), part=part
        ),
    ]


def _baluster(detail: _Detail, bumps: Callable[[np.ndarray], np.ndarray]) -> Shape:
    height = np.linspace(0, 0.8, detail(24, 6))
    radius = 0.045 + 0.025 * np.sin(2 * np.pi * height / 0.8 - 0.7)
    return lathe(height, radius, detail(20, 6), bumps=bumps)


def _figure(detail: _Detail, rng: np.random.Generator, tall: float) -> Shape:
    """A twisted, lobed body with bumps, and a head. Stands on the origin."""
    rows, columns = detail(130, 16), detail(130, 16)
    share = np.linspace(0, 1, rows)
    angle = np.linspace(0, 2 * np.pi, columns + 1)
    lobes, twist = rng.integers(3, 7), rng.uniform(-6, 6)
    bulge = np.interp(share, np.linspace(0, 1, 7), rng.uniform(0.5, 1.0, 7))
    profile = 0.24 * tall * bulge * np.sqrt(np.clip(1 - share**6, 0, 1))
    wave = 1 + 0.16 * np.cos(lobes * angle[None, :] + twist * share[:, None])
    bumps = waves(rng, size=0.35, depth=0.03)
    body = lathe(0.8 * tall * share, profile[:, None] * wave, columns, bumps=bumps)
    head = ball(0.13 * tall, detail(90, 12), bumps=waves(rng, size=0.2, depth=0.02))
    return joined([body, head.moved((0, 0.87 * tall, 0))])


def _wall_pictures(palette: _Palette, rng: np.random.Generator) -> list[Mesh]:
    """Framed pictures between the windows, prints and pictures on the end walls."""
    names = rng.permutation(PAINTINGS + PRINTS)
    frame = palette(colour=(0.55, 0.38, 0.13), roughness=0.45, metallic=1.0)
    places = [
        (side * (_HALF_WIDTH - 0.03), z, -side * np.pi / 2, 1.5)
        for side in (1, -1)
        for z in _column_places()
    ]
    shapes: dict[str, list[Shape]] = {}
    frames = []
    for i, (x, z, turn, wide) in enumerate(places):
        name = str(names[i % len(names)])
        high = wide * rng.uniform(0.7, 1.0)
        low = rng.uniform(1.5, 2.2)
        canvas = picture((-wide / 2, low, 0.04), (wide, 0, 0), (0, high, 0))
        border = box((wide + 0.16, high + 0.16, 0.06)).moved((0, low - 0.08, 0))
        # A turn of `moved` takes +z, to which pictures face, into the hall.
        shapes.setdefault(name, []).append(canvas.moved((x, 0, z), turn))
        frames.append(border.moved((x, 0, z), turn))
    ends = _printed_walls(palette, rng)
    return [
        *(joined(s).mesh(palette(n, roughness=0.6)) for n, s in shapes.items()),
        joined(frames).mesh(frame),
        *ends,
    ]


def _printed_walls(palette: _Palette, rng: np.random.Generator) -> list[Mesh]:
    """Large sheets of small print and two pictures on the end walls."""
    meshes = []
    for side, name in ((1, "page"), (-1, "text")):
        turn = 0.0 if side < 0 else np.pi
        z = side * (_HALF_LENGTH - 0.02)
        sheet = quad((-3.0, 1.4, 0), (6.0, 0, 0), (0, 3.2, 0))
        meshes.append(
            sheet.moved((0, 0.0 if side > 0 else 1.6, z), turn).mesh(
                palette(name, roughness=0.8), repeats=0.8
            )
        )
        for x in (-5.8, 5.8):
            name = str(rng.choice(PAINTINGS))
            view = picture((-1.6, 1.2, 0), (3.2, 0, 0), (0, 2.6, 0))
            meshes.append(
                view.moved((x, 0, z), turn).mesh(palette(name, roughness=0.5))
            )
    return meshes


def _rugs(palette: _Palette, rng: np.random.Generator) -> list[Mesh]:
    rug = palette("rug", roughness=0.95)
    shapes = []
    for z in (-5.5, 1.0, 7.5):
        wide, long = rng.uniform(2.0, 2.8), rng.uniform(3.0, 4.5)
        flat = picture((-wide / 2, 0.012, long / 2), (wide, 0, 0), (0, 0, -long))
        shapes.append(flat.moved((0, 0, z), rng.uniform(-0.1, 0.1)))
    return [joined(shapes).mesh(rug)]


def _crates(
    palette: _Palette, detail: _Detail, rng: np.random.Generator, *, part: int
) -> list[Mesh]:
    """Stacks of crates and barrels in the aisles, and one crate in the nave."""
    planks = palette("planks", roughness=0.8)
    crates, barrels = [], []
    for z in _bays():
        for side in (-1, 1):
            for _ in range(rng.integers(1, 4)):
                x = side * rng.uniform(5.0, 7.2)
                place = (x, 0.0, z + rng.uniform(-1.6, 1.6))
                if rng.random() < 0.35:
                    barrels.append(_barrel(detail).moved(place))
                else:
                    crates += _stack(rng, place)
    slide = box((0.8, 0.8, 0.8)).moved((2.2, 0, -6.0), 0.2)
    iron = palette("metal", colour=(0.55, 0.5, 0.47), roughness=0.7)
    meshes = [joined(crates).mesh(planks, repeats=0.8)]
    meshes.append(slide.mesh(planks, repeats=0.8, part=part))
    if barrels:
        meshes.append(joined(barrels).mesh(iron))
    return meshes


def _stack(rng: np.random.Generator, place: tuple[float, float, float]) -> list[Shape]:
    x, y, z = place
    shapes = []
    for _ in range(rng.integers(1, 4)):
        size = rng.uniform(0.5, 1.0) * (0.85 if shapes else 1.0)
        shapes.append(box((size, size, size)).moved((x, y, z), rng.uniform(0, 1.57)))
        y += size
    return shapes


def _barrel(detail: _Detail) -> Shape:
    height = np.linspace(0, 0.95, detail(20, 6))
    radius = 0.3 + 0.06 * np.sin(np.pi * height / 0.95)
    radius = radius + 0.012 * np.cos(2 * np.pi * height / 0.19)
    # Closed by rows of radius 0 at both ends.
    height = np.concatenate([height[:1], height, height[-1:]])
    radius = np.concatenate([[0], radius, [0]])
    return lathe(height, radius, detail(48, 12))


def _metals(palette: _Palette, detail: _Detail, rng: np.random.Generator) -> list[Mesh]:
    """Pedestals between the columns with balls, rings, vases and figures on them."""
    metals = [
        (1.0, 0.77, 0.34),
        (0.95, 0.64, 0.54),
        (0.91, 0.92, 0.92),
        (0.56, 0.57, 0.58),
    ]
    stone = palette("plaster", roughness=0.6)
    meshes = []
    stands = []
    for i, z in enumerate(_bays()):
        for side in (-1, 1):
            place = (side * _NAVE, 1.0, z)
            stands.append(box((0.7, 1.0, 0.7)).moved((side * _NAVE, 0, z)))
            kind = (2 * i + (side > 0)) % 4
            colour = metals[rng.integers(len(metals))]
            roughness = float(rng.choice([0.12, 0.25, 0.4, 0.6, 0.8]))
            shape = _ornament(kind, detail, rng).moved(place, rng.uniform(0, 6.28))
            if kind == 3:
                material = palette(
                    "stone", colour=(0.95, 0.9, 0.85), roughness=0.5 * roughness
                )
            elif rng.random() < 0.3:
                material = palette("metal", colour=colour, roughness=roughness)
            else:
                material = palette(colour=colour, roughness=roughness, metallic=1.0)
            meshes.append(shape.mesh(material))
    return [joined(stands).mesh(stone), *meshes]


def _ornament(kind: int, detail: _Detail, rng: np.random.Generator) -> Shape:
    """A smooth ball, a bumpy ring, a vase or a small figure, on the origin."""
    if kind == 0:
        return ball(0.33, detail(110, 16)).moved((0, 0.33, 0))
    if kind == 1:
        bumps = waves(rng, size=0.15, depth=0.015, octaves=3)
        hoop = ring(0.27, 0.12, detail(120, 16), bumps=bumps)
        return hoop.moved((0, 0.13, 0))
    if kind == 2:
        share = np.linspace(0, 1, detail(100, 12))
        radius = 0.12 + 0.16 * np.sin(np.pi * share**0.7) ** 2 + 0.05 * share**4
        angle = np.linspace(0, 2 * np.pi, detail(100, 16) + 1)
        ribs = 1 + 0.04 * np.cos(12 * angle)[None, :] * (share < 0.85)[:, None]
        return lathe(0.8 * share, radius[:, None] * ribs, len(angle) - 1)
    return _figure(detail, rng, 1.1)


def _lamps(rng: np.random.Generator) -> list[_Lamp]:
    lamps = []
    for z in (-8.0, -2.0, 4.0, 10.0):
        power = rng.uniform(12, 18)
        place = (0.0, 4.2 + rng.uniform(-0.3, 0.3), z)
        lamps.append(_Lamp(place, (power, 0.78 * power, 0.5 * power)))
    for side in (-1, 1):
        place = (side * 5.8, 3.6, float(rng.choice(_bays())))
        lamps.append(_Lamp(place, (7.2, 7.2, 8.0)))
    return lamps


def _lamp_meshes(
    palette: _Palette, detail: _Detail, lamps: list[_Lamp], *, part: int
) -> list[Mesh]:
    """A chain, a shade that is open below and a glowing bulb in it for each lamp."""
    brass = palette(colour=(0.9, 0.7, 0.35), roughness=0.3, metallic=1.0)
    meshes = []
    for i, (place, light) in enumerate(lamps):
        moves = part if i == 0 else 0
        red, green, blue = (6 * value / max(light) for value in light)
        top = (_VAULT_HEIGHT if place[0] == 0 else _AISLE_HEIGHT) - place[1]
        share = np.linspace(0, 1, detail(24, 5))
        shade = lathe(0.28 * share + 0.02, 0.36 * np.cos(1.35 * share), detail(60, 10))
        chain = lathe(np.linspace(0.25, top, 3), np.full(3, 0.012), 6)
        bulb = ball(0.08, detail(36, 10)).moved((0, 0.12, 0))
        hung = joined([shade, chain]).moved(place)
        meshes.append(hung.mesh(brass, part=moves))
        bulb_material = palette(colour=(0.1, 0.1, 0.1), emissive=(red, green, blue))
        meshes.append(bulb.moved(place).mesh(bulb_material, part=moves))
    return meshes


def _lights(rng: np.random.Generator, lamps: list[_Lamp]) -> Lights:
    """The sun on the side of +x, a sky, and every lamp's light below its bulb."""
    azimuth = rng.uniform(-0.5, 0.5)
    elevation = rng.uniform(0.45, 0.75)
    level = np.cos(elevation)
    return Lights(
        sun_direction=(
            level * np.cos(azimuth),
            np.sin(elevation),
            level * np.sin(azimuth),
        ),
        sun=(20.0, 18.0, 15.0),
        point_position=[lamp.place for lamp in lamps],
        point_intensity=[lamp.light for lamp in lamps],
        sky=(0.42, 0.50, 0.62),
        ground=(0.34, 0.29, 0.24),
    )


def _animation(lamps: list[_Lamp]) -> Animation:
    time = np.linspace(0, 8, 33)
    phase = 2 * np.pi * time / 8
    still = np.zeros((len(time), 3))
    swing, turn, slide = still.copy(), still.copy(), still.copy()
    swing[:, 0] = 0.35 * np.sin(2 * phase)
    turn[:, 1] = phase
    slide[:, 2] = 2.0 * np.sin(phase)
    x, _, z = lamps[0].place
    return Animation(
        time=time,
        pivot=[(x, _VAULT_HEIGHT, z), (0, 0, -12.6), (0, 0, 0)],
        translation=[still, still, slide],
        rotation=[swing, turn, still],
        light_part=[_PART_LAMP] + [0] * (len(lamps) - 1),
    )

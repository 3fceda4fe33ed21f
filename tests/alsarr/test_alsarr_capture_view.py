"""A view's files, its channels, and the frame that it is to the controller."""

import zipfile

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from alsarr import RATES, tile_luminance
from alsarr.capture import Camera, CHANNELS, load_view, save_view, View, views
from alsarr.capture._view import most_bytes, view_path


WIDTH, HEIGHT = 40, 24
# Those with a value or three a pixel, a row of the picture after the other.
PIXELS = ("normal", "diffuse", "specular", "roughness", "depth", "uv", "texture")
PIXELS += ("mip_level", "shadow", "motion", "reprojected", "seen")


@pytest.fixture(scope="module")
def view():
    """Drawn numbers of every field, with sky in the first rows."""
    rng = np.random.default_rng(0)
    byte = lambda *shape: rng.integers(0, 256, shape, np.uint8)
    size = (HEIGHT, WIDTH)
    normal = rng.normal(size=(*size, 3))
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    normal[:4] = 0
    depth = rng.random(size, np.float32) + 1
    depth[:4] = np.inf
    return View(
        images=byte(len(RATES), *size, 3),
        normal=normal.astype(np.float16),
        diffuse=byte(*size, 3),
        specular=byte(*size, 3),
        roughness=byte(*size),
        depth=depth,
        uv=rng.random((*size, 2), np.float32),
        texture=rng.integers(0, 3, size).astype(np.uint16),
        mip_level=(4 * rng.random(size)).astype(np.float16),
        shadow=np.where(rng.random(size) < 0.5, 0, 255).astype(np.uint8),
        motion=rng.normal(size=(*size, 2)).astype(np.float32),
        reprojected=byte(*size, 3),
        seen=rng.random(size) < 0.8,
        invocations=np.arange(7, dtype=np.int32),
        exposure=np.asarray(1.5, np.float32),
        time=np.asarray(0.25, np.float32),
        camera=Camera((0, 1, 2), (0.1, -0.2, -1), fov_y=50.0),
        previous_camera=Camera((0, 1, 2.1), (0.1, -0.2, -1), fov_y=50.0),
        scene="drawn",
    )


def test_a_view_that_is_read_is_the_view_that_was_written(view, tmp_path):
    path = view_path(tmp_path / "new", 3)
    save_view(path, view)
    read = load_view(path)
    for name, dtype in View.ARRAYS.items():
        got = getattr(read, name)
        assert got.dtype == dtype
        np.testing.assert_array_equal(got, getattr(view, name))
    for camera in ("camera", "previous_camera"):
        for name in ("position", "forward", "up", "fov_y"):
            got, given = (getattr(getattr(v, camera), name) for v in (read, view))
            np.testing.assert_allclose(got, given, rtol=1e-6, atol=1e-7)
    assert read.scene == "drawn" and read.size == (WIDTH, HEIGHT)
    assert path.name == "view_00003.npz"
    assert [p.name for p in path.parent.iterdir()] == [path.name]
    # Noise cannot be packed: this is what the largest file is like.
    assert path.stat().st_size <= most_bytes((WIDTH, HEIGHT))
    np.testing.assert_array_equal(read.reference, view.images[6])


def test_the_same_view_is_the_same_file(view, tmp_path):
    for name in ("a.npz", "b.npz"):
        save_view(tmp_path / name, view)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def broken(view, tmp_path, change):
    path = tmp_path / "view.npz"
    save_view(path, view)
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    change(arrays)
    np.savez(path, **arrays)
    return path


def test_files_of_something_else_are_refused_by_name(view, tmp_path):
    path = tmp_path / "view.npz"
    path.write_bytes(b"nothing")
    with pytest.raises(ValueError, match=r"view\.npz: is no NPZ file"):
        load_view(path)
    np.savez(path, depth=np.zeros((2, 2)))
    with pytest.raises(ValueError, match="must be a view with schema alsarr-view/1"):
        load_view(path)
    with pytest.raises(FileNotFoundError):
        load_view(tmp_path / "none.npz")
    save_view(path, view)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"view\.npz: is no NPZ file"):
        load_view(path)
    assert zipfile.is_zipfile(tmp_path / "view.npz") is False


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda a: a.pop("motion"), "lacks the arrays motion"),
        (
            lambda a: a.update(seen=a["seen"][1:]),
            r"`seen` must have shape \[24, 40\], got \[23, 40\]",
        ),
        (
            lambda a: a.update(depth=a["depth"][0]),
            r"`depth` must have shape \[height, width\], none of them 0, got \[40\]",
        ),
        (
            lambda a: a.update(
                {n: a[n][:0] for n in PIXELS}, images=a["images"][:, :0]
            ),
            r"`depth` must have shape .* none of them 0, got \[0, 40\]",
        ),
        (
            lambda a: a.update(camera_position=np.zeros(2, "f4")),
            r"`camera_position` must have shape \[3\], got \[2\]",
        ),
        (
            lambda a: a.update(previous_camera_fov_y=np.full(2, 50, "f4")),
            r"`previous_camera_fov_y` must have shape \[\], got \[2\]",
        ),
        (
            lambda a: a.update(camera_up=np.array(["a", "b", "c"])),
            "`camera_up` must be float32, got <U1",
        ),
        (
            lambda a: a.update(camera_forward=np.zeros(3, "f4")),
            "camera: `forward` must be not 0, got 0",
        ),
        (
            lambda a: a.update(previous_camera_position=np.full(3, np.inf, "f4")),
            "previous_camera: `position` must be finite, got inf",
        ),
        (
            lambda a: a["depth"].fill(np.nan),
            "`depth` must be finite, or inf for the sky, got nan",
        ),
        (lambda a: a["motion"].fill(np.nan), "`motion` must be finite, got nan"),
        (lambda a: a["normal"].fill(np.nan), "`normal` must be finite, got nan"),
        (lambda a: a["exposure"].fill(np.inf), "`exposure` must be finite, got inf"),
        (
            lambda a: a.update(roughness=a["roughness"].astype(np.int16)),
            "`roughness` must be uint8, got int16",
        ),
        (lambda a: a.update(scene=np.array([object()])), "something else than whole"),
    ],
)
def test_damaged_files_are_refused_in_words(view, tmp_path, change, message):
    with pytest.raises(ValueError, match=r"view\.npz: .*" + message) as error:
        load_view(broken(view, tmp_path, change))
    assert "\n" not in str(error.value)


def test_views_are_listed_by_number(view, tmp_path):
    with pytest.raises(ValueError, match="must be a folder with views, has none"):
        views(tmp_path)
    for index in (2, 10, 1):
        save_view(view_path(tmp_path, index), view)
    (tmp_path / "capture.json").write_text("{}")
    assert [path.stem for path in views(tmp_path)] == [
        *("view_00001", "view_00002", "view_00010")
    ]


def test_channels_are_shares_and_unit_vectors(view):
    found = view.channels()
    assert tuple(found) == CHANNELS
    for name, channel in found.items():
        assert channel.shape == (HEIGHT, WIDTH) and channel.dtype == np.float32
        assert channel.min() >= (-1 if name.startswith("normal") else 0)
        assert channel.max() <= 1
    np.testing.assert_allclose(found["diffuse_green"] * 255, view.diffuse[..., 1])
    np.testing.assert_allclose(
        found["reprojected_blue"] * 255, view.reprojected[..., 2]
    )
    np.testing.assert_array_equal(found["normal_z"], view.normal[..., 2])
    np.testing.assert_array_equal(found["seen"], view.seen)
    np.testing.assert_array_equal(found["shadow"], view.shadow // 255)


def test_reflect_is_the_cosine_to_the_viewer(view):
    got = view.channels(["reflect"])["reflect"]
    # In view space a ray's tangents follow from the angle of view alone.
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    down = np.tan(np.radians(25.0))
    away = np.stack(
        [
            (2 * x / WIDTH - 1) * down * WIDTH / HEIGHT,
            (1 - 2 * y / HEIGHT) * down,
            -np.ones_like(x),
        ],
        axis=2,
    )
    away /= np.linalg.norm(away, axis=2, keepdims=True)
    cosine = -np.sum(away * view.normal.astype(float), axis=2)
    np.testing.assert_allclose(got, np.clip(cosine, 0, 1), atol=1e-5)
    np.testing.assert_array_equal(got[:4], 0)


def test_channels_of_no_such_name(view):
    with pytest.raises(ValueError, match=r"`names` must be of .*, got 'colour'"):
        view.channels(["seen", "colour"])


def test_a_frame_has_what_each_tile_shows(view):
    frame = view.frame(ppd=40.0, refresh_rate=80.0, peak_luminance=300.0)
    assert frame.shape == (2, 3)
    for row in range(2):
        for column in range(3):
            # The last row and column are cut by the edge.
            tile = np.s_[row * 16 : row * 16 + 16, column * 16 : column * 16 + 16]
            count = np.bincount(view.texture[tile].ravel())
            texture = int(frame.texture[row, column])
            assert texture == count.argmax()
            level = view.mip_level[tile][view.texture[tile] == texture]
            np.testing.assert_allclose(
                frame.mip_level[row, column], level.astype(float).mean(), rtol=1e-5
            )
            # Two degrees a second are a pixel a frame here.
            slowest = 2 * np.abs(view.motion[tile]).min(axis=(0, 1))
            velocity = (frame.velocity_x, frame.velocity_y)
            got = [float(v[row, column]) for v in velocity]
            np.testing.assert_allclose(got, slowest, rtol=1e-5)
    np.testing.assert_allclose(
        frame.luminance, tile_luminance(jnp.asarray(view.images[6]), 300.0)
    )
    np.testing.assert_allclose(frame.previous_image * 255, view.reprojected, rtol=1e-5)
    assert tuple(frame.channels) == CHANNELS


def test_of_textures_as_frequent_the_first_is_taken(view):
    half = np.zeros((HEIGHT, WIDTH), np.uint16)
    half[:, ::2] = 5
    half[:, 1::2] = 2
    even = eqx.tree_at(lambda v: v.texture, view, half)
    frame = even.frame(ppd=40.0, refresh_rate=80.0, peak_luminance=300.0)
    np.testing.assert_array_equal(frame.texture, 2)


def test_a_picture_is_put_together_tile_by_tile(view):
    width, height = view.size
    rows, columns = -(-height // 16), -(-width // 16)
    rate = np.random.default_rng(5).integers(0, len(RATES), (rows, columns))
    found = view.shaded(rate)
    expected = np.zeros_like(view.reference)
    for row in range(rows):
        for column in range(columns):
            tile = np.s_[16 * row : 16 * row + 16, 16 * column : 16 * column + 16]
            expected[tile] = view.images[rate[row, column]][tile]
    np.testing.assert_array_equal(found, expected)
    finest = np.full_like(rate, RATES.names.index("1x1"))
    np.testing.assert_array_equal(view.shaded(finest), view.reference)


def test_a_picture_of_other_tiles_or_rates_is_refused(view):
    width, height = view.size
    tiles = -(-height // 16), -(-width // 16)
    shape = rf"\[{tiles[0]}, {tiles[1]}\], one for each tile, got \[1, 1\]"
    with pytest.raises(ValueError, match=f"`rate` must have shape {shape}"):
        view.shaded(np.zeros((1, 1), int))
    with pytest.raises(ValueError, match=r"`rate` must be in \[0, 7\), got -1 to -1"):
        view.shaded(np.full(tiles, -1))

"""Which samples a rate needs: one a coarse pixel and triangle, and who they colour."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from alsarr import RATES
from alsarr.capture import coarse_invocations
from alsarr.capture._coarse import every_pixel


CELLS = [tuple(size) for size in RATES.size.tolist()]
# The second is cut by its edges at every rate but 1x1.
SHAPES = ((16, 24), (13, 19))


def oracle(triangle, cell):
    """Each cell's triangles, by loops: {(row, column, triangle): its pixels}."""
    found = {}
    for (y, x), seen in np.ndenumerate(triangle):
        found.setdefault((y // cell[1], x // cell[0], seen), []).append((x, y))
    return found


def check(triangle, cell):
    got, expected = coarse_invocations(triangle, cell), oracle(triangle, cell)
    assert len(got) == len(expected)
    # Every pixel is coloured by the sample of its own cell and triangle.
    owners = {}
    for (y, x), owner in np.ndenumerate(got.owner):
        assert got.triangle[owner] == triangle[y, x]
        owners.setdefault(int(owner), []).append((x, y))
    assert sorted(owners) == list(range(len(got)))
    for owner, pixels in owners.items():
        row, column = pixels[0][1] // cell[1], pixels[0][0] // cell[0]
        assert sorted(pixels) == sorted(expected[row, column, got.triangle[owner]])
        centre = np.array([(column + 0.5) * cell[0], (row + 0.5) * cell[1]])
        np.testing.assert_array_equal(got.centre[owner], centre)
        places = np.array(pixels) + 0.5
        assert (got.covered[owner] == places).all(axis=1).any()
        least = np.linalg.norm(places - centre, axis=1).min()
        assert np.linalg.norm(got.covered[owner] - centre) == least


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("cell", CELLS)
def test_one_sample_for_each_cell_and_triangle(cell, shape):
    for seed in range(2):
        rng = np.random.default_rng(seed)
        check(rng.integers(-1, 4, shape).astype(np.int32), cell)
    blocks = np.kron(np.arange(25).reshape(5, 5), np.ones((5, 5), int))
    check(blocks[: shape[0], : shape[1]].astype(np.int32), cell)


@settings(deadline=None, max_examples=30)
@given(st.lists(st.integers(-1, 2), min_size=64, max_size=64))
def test_any_picture_of_few_triangles(seen):
    check(np.array(seen, np.int32).reshape(8, 8), (4, 4))


@pytest.mark.parametrize("cell", CELLS)
def test_a_single_triangle_takes_one_sample_a_coarse_pixel(cell):
    height, width = SHAPES[0]
    got = coarse_invocations(np.zeros((height, width), np.int32), cell)
    assert len(got) == width * height // (cell[0] * cell[1])
    np.testing.assert_array_equal(np.bincount(got.owner.ravel()), cell[0] * cell[1])


def test_as_many_triangles_as_pixels_save_nothing():
    seen = np.arange(16 * 24, dtype=np.int32).reshape(16, 24)
    for cell in CELLS:
        got = coarse_invocations(seen, cell)
        assert len(got) == 16 * 24
        # Each can be shaded nowhere else than at its only pixel.
        y, x = np.divmod(got.triangle, 24)
        np.testing.assert_array_equal(got.covered, np.stack([x, y], axis=1) + 0.5)


def test_full_rate_is_the_plain_order_of_pixels():
    seen = np.random.default_rng(0).integers(-1, 9, (13, 19)).astype(np.int32)
    coarse, plain = coarse_invocations(seen, (1, 1)), every_pixel(seen)
    for name in ("triangle", "centre", "covered", "owner"):
        np.testing.assert_array_equal(getattr(coarse, name), getattr(plain, name))


def test_finer_rates_never_take_fewer_samples():
    seen = np.random.default_rng(1).integers(0, 3, (6, 8)).astype(np.int32)
    seen = np.kron(seen, np.ones((3, 3), np.int32))[:16]
    number = [len(coarse_invocations(seen, cell)) for cell in CELLS]
    count = dict(zip(RATES.names, number, strict=True))
    for fine, coarse in (
        *(("1x1", "1x2"), ("1x1", "2x1"), ("1x2", "2x2"), ("2x1", "2x2")),
        *(("2x2", "2x4"), ("2x2", "4x2"), ("2x4", "4x4"), ("4x2", "4x4")),
    ):
        assert count[coarse] < count[fine]

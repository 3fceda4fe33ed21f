import numpy as np
import pytest

from alsarr._rates import nearest_finer, RATES, TILE


def test_order_is_width_by_height_of_the_coarse_pixel():
    assert RATES.names == ("4x4", "2x4", "4x2", "2x2", "1x2", "2x1", "1x1")
    assert len(RATES) == 7
    golden = [[4, 4], [2, 4], [4, 2], [2, 2], [1, 2], [2, 1], [1, 1]]
    np.testing.assert_array_equal(RATES.size, golden)
    np.testing.assert_array_equal(RATES.resolution * RATES.size, 1)


def test_cost_is_the_number_of_shaded_pixels_of_a_tile():
    np.testing.assert_array_equal(RATES.cost, [16, 32, 32, 64, 128, 128, 256])
    np.testing.assert_array_equal(RATES.relative_cost, [1, 2, 2, 4, 8, 8, 16])
    np.testing.assert_array_equal(RATES.cost, TILE**2 * RATES.resolution.prod(axis=1))


def test_code_is_that_of_direct3d_12():
    # D3D12_SHADING_RATE: 1x1 0, 1x2 1, 2x1 4, 2x2 5, 2x4 6, 4x2 9, 4x4 10.
    np.testing.assert_array_equal(RATES.code, [0xA, 0x6, 0x9, 0x5, 0x1, 0x4, 0x0])


def test_code_decodes_by_the_rule_of_vulkan():
    # Vulkan specification: w = 2^((texel >> 2) & 3), h = 2^(texel & 3).
    width, height = 2 ** (RATES.code >> 2 & 3), 2 ** (RATES.code & 3)
    np.testing.assert_array_equal(np.stack([width, height], axis=1), RATES.size)


def test_colours_are_those_of_the_paper():
    as_hex = [bytes(row).hex().upper() for row in RATES.colour]
    assert as_hex == "ED1C24 EE8722 FBB040 8DC63F 2BB673 00A79D 1C75BC".split()


def test_nothing_can_be_changed():
    with pytest.raises(AttributeError):
        RATES.cost = np.zeros(7)  # pyright: ignore[reportAttributeAccessIssue]
    for name in ("size", "resolution", "cost", "relative_cost", "colour", "code"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(RATES, name)[0] = 0


@pytest.mark.parametrize(
    "available, expected",
    [
        (RATES.names, RATES.names),
        (("1x1",), ("1x1",) * 7),
        (("1x1", "2x4", "4x2"), ("2x4", "2x4", "4x2", "1x1", "1x1", "1x1", "1x1")),
        (("2x1", "1x2", "1x1"), ("1x2", "1x2", "1x2", "1x2", "1x2", "2x1", "1x1")),
    ],
)
def test_nearest_finer(available, expected):
    found = nearest_finer(available)
    assert tuple(RATES.names[i] for i in found) == expected
    assert np.all(RATES.size[found] <= RATES.size)


@pytest.mark.parametrize(
    "available, shown", [(("4x4",), "4x4"), (("1x1", "1x4"), "1x1, 1x4"), ((), "none")]
)
def test_nearest_finer_needs_known_rates_and_the_finest(available, shown):
    with pytest.raises(ValueError, match=f"`available` must be 1x1 .*, got {shown}"):
        nearest_finer(available)

import numpy as np

from camojab import datasets
from camojab._shipped import shipped


def test_every_shipped_file_is_documented():
    folder = shipped("README.md").parent
    text = (folder / "README.md").read_text(encoding="utf-8")
    names = {path.name for path in folder.iterdir() if path.is_file()} - {"README.md"}
    assert {"displays.json", "mackin2016.csv"} <= names
    assert {name for name in names if f"`{name}`" not in text} == set()


def test_mackin2016():
    table = datasets.mackin2016()
    assert len(table) == 28
    np.testing.assert_array_equal(
        table["refresh_rate_hz"], np.tile([60, 100, 150, 300, 600, 1000, 2000], 4)
    )
    np.testing.assert_array_equal(
        table["velocity_deg_s"], np.repeat([10, 30, 50, 70], 7)
    )
    assert table["mean_impairment_score"].between(1, 5).all()
    # Table 5: a prediction that ignores the refresh rate (NAS) scores 1.04, the spread.
    assert round(table["mean_impairment_score"].std(ddof=0), 2) == 1.04
    assert_within_error_bars(table, "mean_impairment_score")


def test_itu_refresh_rate():
    table = datasets.itu_bt2246_refresh_rate()
    assert len(table) == 6
    used = table[table["shutter"] == 1]
    np.testing.assert_array_equal(used["refresh_rate_hz"], [30, 60, 120, 240])
    np.testing.assert_array_equal(used["quality_score"], [-2.9, -2.0, -1.0, 0.011])
    # Table 5, as above: 1.09.
    assert round(used["quality_score"].std(ddof=0), 2) == 1.09
    assert_within_error_bars(table, "quality_score")


def test_itu_resolution():
    table = datasets.itu_bt2246_resolution()
    assert len(table) == 6
    used = table[table["upscaling"] != "Lanczos"]
    assert list(used["upscaling"]) == ["nearest", "nearest", "none"]
    np.testing.assert_array_equal(used["quality_score"], [39, 73, 89])
    np.testing.assert_array_equal(table["rate"], table["width_px"] / 3840)
    np.testing.assert_array_equal(table["rate"], table["height_px"] / 2160)
    assert_within_error_bars(table, "quality_score")


def assert_within_error_bars(table, score):
    assert (table["low_score"] < table[score]).all()
    assert (table[score] < table["high_score"]).all()


def test_displays_are_the_published_ones():
    table = datasets.displays().set_index("name")
    values = table[["ppd", "refresh_rate_hz", "mean_luminance_cd_m2", "persistence"]]
    published = {
        "jindal2021_pc": (50, 144, 150, 1),
        "jindal2021_mobile": (90, 60, 75, 1),
        "jindal2021_vr": (13, 144, 2.5, 0.05),
        "jindal2021_example": (60, 60, 150, 1),
        "denes2020": (2560 / 30, 165, 100, 1),
    }
    assert list(values.index) == list(published)
    np.testing.assert_allclose(values.to_numpy(), list(published.values()))
    assert {dtype.kind for dtype in values.dtypes} == {"f"}
    assert table["source"].str.contains("2020|2021").all()

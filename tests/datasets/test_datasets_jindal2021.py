import csv
import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from camojab import datasets


VOTES = "jindal2021/Experiment_Data/vrs_exp_data.csv"
JND = "jindal2021/Experiment_Data/vrs_exp_data_jnd.mat"
STIMULI = "jindal2021/Experiment_Data/vrs_exp_stimulus.mat"
VALIDATION = "jindal2021/Experiment_Data/alsarr_validation_experiment.csv"
SAMPLE = "jindal2021/CaMoJAB/sample_texture.png"
FRAME = (
    "jindal2021/ALSaRR/sample_data/motion_n.exr",
    "jindal2021/ALSaRR/sample_data/materials_n.exr",
)
TABLES = "jindal2021/ALSaRR/sample_data/all_polynomials.zip"
GOLDEN = json.loads(
    (Path(__file__).parent / "golden" / "jindal2021_wins.json").read_text()
)

TEXTURES = ["checkerboard", "gradient_linear", "grass", "noise"]
CONDITIONS = [(None, 1.0)] + [(t, r) for t in TEXTURES for r in (0.5, 0.25)]


def condition(texture, rate):
    return CONDITIONS.index((None if rate == 1 else texture, rate))


def rms(x):
    return np.sqrt(np.mean(np.square(x)))


def test_votes_are_all_there(real_data):
    real_data(VOTES)
    votes = datasets.jindal2021_votes()
    assert len(votes) == 4764
    assert not votes.isna().any(axis=None)
    assert votes["block"].value_counts().to_dict() == {
        "PC": 1644,
        "Mobile": 1560,
        "VR": 1560,
    }
    assert votes["observer"].nunique() == 13
    assert set(votes["texture_a"]) == set(votes["texture_b"]) == set(TEXTURES)
    assert set(votes["persistence"]) == {1.0, 0.04}
    with open(datasets.fetch(VOTES), newline="") as file:
        first = next(csv.DictReader(file))
    row = votes.iloc[0]
    assert (row["observer"], row["texture_a"]) == (first["Observer"], "noise")
    assert row["rate_x_b"] == float(first["Stimulus2_resolution"]) == 1
    assert not row["a_preferred"] and first["User_Selection"] == "2"


@pytest.mark.parametrize("side", ["refresh_rate", "mean_lum", "persistence", "fovx"])
def test_display_columns_hold_for_both_sides(real_data, side):
    real_data(VOTES)
    with open(datasets.fetch(VOTES), newline="") as file:
        for row in csv.DictReader(file):
            assert row[f"Stimulus1_{side}"] == row[f"Stimulus2_{side}"]


@pytest.mark.parametrize(
    "cell", GOLDEN["cells"], ids=lambda c: f"{c['block']}-{c['velocity_deg_s']}"
)
def test_selection_code_1_means_that_a_won(real_data, cell):
    real_data(VOTES)
    votes = datasets.jindal2021_votes()
    votes = votes[
        (votes["block"] == cell["block"])
        & (votes["velocity_deg_s"] == cell["velocity_deg_s"])
    ]
    wins = np.zeros((9, 9), int)
    for vote in votes.itertuples():
        a = condition(vote.texture_a, vote.rate_x_a)
        b = condition(vote.texture_b, vote.rate_x_b)
        wins[(a, b) if vote.a_preferred else (b, a)] += 1
    np.testing.assert_array_equal(wins, cell["wins"])


def test_jnd_has_every_condition_once(real_data):
    real_data(JND)
    table = datasets.jindal2021_jnd()
    assert len(table) == 108
    keys = ["block", "texture", "velocity_deg_s", "rate_x"]
    assert not table.duplicated(keys).any()
    np.testing.assert_array_equal(
        table["tracked_velocity_deg_s"], np.abs(table["velocity_deg_s"] - 2)
    )
    assert (table["rate_y"] == 1).all()
    display = ["ppd", "refresh_rate_hz", "mean_luminance_cd_m2", "persistence"]
    blocks = table.groupby("block", sort=False)[[*display, "mip_level"]].first()
    assert [tuple(row) for row in blocks.to_numpy()] == [
        (50, 144, 150, 1, 3),
        (90, 60, 75, 1, 1),
        (26, 144, 2.5, 0.05, 5),
    ]


def test_jnd_values(real_data):
    real_data(JND)
    table = datasets.jindal2021_jnd()
    # What a constant prediction scores on the published file, block by block.
    for block, expected in [("PC", 2.309), ("Mobile", 1.750), ("VR", 1.191)]:
        quality = table.loc[table["block"] == block, "quality_jnd"]
        np.testing.assert_allclose(rms(quality), expected, atol=5e-4)
    full = table[table["rate_x"] == 1]
    np.testing.assert_array_equal(full["quality_jnd"], 0)
    # Distances from the quality: positive even where the quality is far below zero.
    assert (table["low_jnd"] < table["quality_jnd"]).all()
    assert (table["quality_jnd"] < table["high_jnd"]).all()


@pytest.mark.parametrize(
    "cell", GOLDEN["cells"], ids=lambda c: f"{c['block']}-{c['velocity_deg_s']}"
)
def test_jnd_axes_agree_with_the_votes_scaled_anew(real_data, cell):
    real_data(JND)
    table = datasets.jindal2021_jnd()
    table = table[
        (table["block"] == cell["block"])
        & (table["velocity_deg_s"] == cell["velocity_deg_s"])
    ]
    for row in table.itertuples():
        scaled = cell["jnd_gaussian_fix0"][condition(row.texture, row.rate_x)]
        # The file was made with another prior, which moves a condition by 0.55 at most.
        assert abs(row.quality_jnd - scaled) < 0.56


def test_textures(real_data):
    real_data(STIMULI)
    textures = datasets.jindal2021_textures()
    assert list(textures) == [*TEXTURES, "marrr_checkerboard"]
    for texture in textures.values():
        assert texture.shape == (512, 512) and texture.dtype == np.float64
        assert texture.min() >= 0 and texture.max() <= 1
    np.testing.assert_allclose(np.unique(textures["checkerboard"]), [0.15, 0.5, 0.85])
    # Its lines are vertical: the file is column-major, the array is (y, x).
    ramp = textures["gradient_linear"]
    assert (ramp == ramp[:1]).all() and len(np.unique(ramp[0])) == 395


def test_sample_texture(real_data):
    real_data(SAMPLE)
    image = datasets.jindal2021_sample_texture()
    assert image.shape == (1024, 1024, 4) and image.dtype == np.uint8
    assert (image[..., 3] == 255).all() and image[..., :3].std() > 10


def test_validation_votes(real_data):
    real_data(VALIDATION)
    votes = datasets.jindal2021_validation_votes()
    assert len(votes) == 1297
    assert not votes.isna().any(axis=None)
    assert votes["observer"].nunique() == 12
    assert set(votes["scene"]) == {"lemon", "sally", "scifi"}
    assert votes.groupby("scene")["motion"].nunique().eq(4).all()
    settings = votes.groupby(["budget", "against", "uniform_setting"])
    assert settings.size().to_dict() == {
        (0.0625, "marrr", "1x1"): 216,
        (0.0625, "uniform", "2x2"): 216,
        (0.0625, "uniform", "4x4"): 217,
        (0.125, "marrr", "1x1"): 216,
        (0.125, "uniform", "2x2"): 216,
        (0.125, "uniform", "4x2"): 216,
    }
    # The paper: a clear preference for ALSaRR in every condition.
    assert settings["alsarr_preferred"].mean().min() > 0.6
    with open(datasets.fetch(VALIDATION), newline="") as file:
        raw = Counter((row["scene"], row["answer"]) for row in csv.DictReader(file))
    third = votes[votes["motion"] == "third_person"]
    assert set(third["scene"]) == {"lemon"}
    assert third["alsarr_preferred"].sum() == raw["LemonChanged_ThirdPerson", "1"]


def test_frame(real_data):
    real_data(*FRAME)
    frame = datasets.jindal2021_frame()
    assert frame.material.min() == 0 and frame.material.max() == 49
    assert len(np.unique(frame.material)) == 39
    assert frame.mip_level.min() == 0 and frame.mip_level.max() == 11
    assert frame.motion_x.min() >= 0 and frame.motion_y.max() < 1
    velocity = frame.velocity_deg_s(refresh_rate_hz=60, ppd=30)
    np.testing.assert_allclose(
        velocity[0, 0], [0.221435546875 * 38.4, frame.motion_y[0, 0] * 21.6]
    )
    with pytest.raises(ValueError, match=r"`ppd` must be > 0 and finite, got 0\."):
        frame.velocity_deg_s(refresh_rate_hz=60, ppd=0)


def test_material_tables(real_data):
    real_data(TABLES)
    materials = datasets.jindal2021_material_tables()
    names, tables = materials.names, materials.coefficients
    assert len(names) == 50 and list(names) == sorted(names)
    assert (names[0], names[1], names[-1]) == (
        "0000skybox",
        "Bird (Instance)",
        "zzzzUniform",
    )
    assert np.isfinite(tables).all()
    np.testing.assert_allclose(tables[0], tables[0][[0] * 12], rtol=1e-13)
    empty = np.argwhere((tables == 0).all(axis=(2, 3)))
    wall = names.index("MarketWallStone (Instance)")
    assert empty.tolist() == [[wall, 0], *([49, level] for level in range(12))]


# Three tiles of the authors' frame at 60 Hz, 60 px/deg and 50.01 cd/m2: the rates 4x4,
# 2x4, 4x2, 2x2, 1x2, 2x1 and 1x1, with the 0.1 that the authors add to each. Computed
# with ALSaRR/adaptive_vrs.m (gfxdisp/ALSaRR d06b3e0) in GNU Octave 7.3 on 2026-11-22.
TILES = {
    (0, 0): [
        0.1,
        0.12491425514407378,
        0.12677193161764377,
        0.15168618676171758,
        0.19692042224498046,
        0.20009114096589065,
        0.24532537644915356,
    ],
    (0, 67): [
        0.1,
        0.1990798113600328,
        0.1990759882296521,
        0.29815579958968497,
        0.3894216959033229,
        0.3894175197132762,
        0.4806834160269142,
    ],
    (66, 119): [
        0.1,
        0.24125643797325086,
        0.24158907096620677,
        0.38284550893945757,
        0.5923336936034347,
        0.5928560329429496,
        0.8023442176069268,
    ],
}


@pytest.mark.parametrize("tile", TILES, ids=str)
def test_frame_and_tables_give_the_qualities_of_the_authors(real_data, tile):
    real_data(*FRAME, TABLES)
    frame = datasets.jindal2021_frame()
    materials = datasets.jindal2021_material_tables()
    velocity = frame.velocity_deg_s(refresh_rate_hz=60, ppd=60)[tile]
    w = materials.coefficients[frame.material[tile], frame.mip_level[tile]]
    f, z = 60.0, np.log10(50.01)

    def quality(v, size):
        if size == 4:
            return 0.0
        w0, w1, w2, w3, w4, w5, *cubic = w[0 if size == 2 else 1]
        plane = w0 + w1 * v + w2 * f + w3 * v**2 + w4 * v * f + w5 * f**2
        return plane * np.polyval(cubic, z)

    sizes = [(4, 4), (2, 4), (4, 2), (2, 2), (1, 2), (2, 1), (1, 1)]
    got = [
        (quality(velocity[0], m) + quality(velocity[1], n)) / 2 + 0.1 for m, n in sizes
    ]
    np.testing.assert_allclose(got, TILES[tile], rtol=1e-12)

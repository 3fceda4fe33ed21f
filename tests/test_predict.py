import os

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st
from skimage.io import imsave

from camojab import (
    _predict,
    _textures,
    Components,
    Display,
    distortion,
    Exact,
    Formulation,
    Parameters,
    Pooled,
    quality,
    Shading,
    Spectrum,
    Viewing,
)
from camojab._columns import TableError
from camojab._predict import predict
from camojab.datasets import builtin_textures


ROW = {
    "texture": "noise",
    "mean_luminance_cd_m2": 100.0,
    "refresh_rate_hz": 60.0,
    "velocity_deg_s": 10.0,
    "persistence": 1.0,
    "ppd": 60.0,
    "rate_x": 0.5,
    "rate_y": 1.0,
    "mip_level": 1.0,
}

PARAMETERS = {
    Formulation.RELEASED: {"ws": -3.7, "wt": -2.9, "beta": 0.36},
    Formulation.PAPER: {"ws": -0.005, "wt": -0.004, "beta": 0.4},
}


def textures():
    rng = np.random.default_rng(7)
    return {"noise": rng.random((64, 64)), "other": rng.random((32, 96))}


def conditions(rows):
    """A table of `rows` conditions of two textures, one as often as the other."""
    rng = np.random.default_rng(rows)
    return pd.DataFrame(
        {
            "texture": np.resize(["noise", "other"], rows),
            "mean_luminance_cd_m2": rng.uniform(1, 300, rows),
            "refresh_rate_hz": rng.uniform(30, 165, rows),
            "velocity_deg_s": rng.uniform(0, 40, rows),
            "persistence": rng.uniform(0.1, 1, rows),
            "ppd": rng.uniform(20, 90, rows),
            "rate_x": rng.choice([1, 0.5, 0.25], rows),
            "rate_y": rng.choice([1, 0.5, 0.25], rows),
            "mip_level": rng.integers(0, 6, rows),
        }
    )


def one(**changes):
    return pd.DataFrame([ROW | changes])


def rtol():
    # Sums of 512 x 512 terms, in another order.
    return 1e-12 if jax.config.jax_enable_x64 else 1e-5


@pytest.mark.parametrize("formulation", list(Formulation))
def test_every_row_is_what_the_model_gives_alone(formulation):
    constants = Parameters(**PARAMETERS[formulation])
    table = conditions(7)
    got = predict(
        table, formulation=formulation, parameters=constants, textures=textures()
    )
    for i, row in table.iterrows():
        condition = (
            Spectrum.from_texture(textures()[row["texture"]]),
            Display(
                ppd=row["ppd"],
                refresh_rate=row["refresh_rate_hz"],
                luminance=row["mean_luminance_cd_m2"],
                persistence=row["persistence"],
            ),
            Viewing(row["velocity_deg_s"]),
            Shading(
                rate_x=row["rate_x"], rate_y=row["rate_y"], mip_level=row["mip_level"]
            ),
            constants,
        )
        parts = distortion(*condition, formulation=formulation)
        expected = quality(*condition, formulation=formulation)
        alone = got.loc[i]
        close = lambda a, b: np.testing.assert_allclose(a, b, rtol=rtol())
        close(alone["spatial_distortion"], parts.spatial)
        close(alone["temporal_distortion"], parts.temporal)
        close(alone["quality_jnd"], expected)


def test_optional_columns_take_the_place_of_the_defaults():
    table = pd.concat([one()] * 6, ignore_index=True)
    table["beta"] = [0.36, 0.5, 0.36, 0.36, 0.36, 0.36]
    table["vrs"] = [1, 1, 0, 1, 1, 0]
    table["eye_blur"] = [1, 1, 1, 0, 1, 0]
    table["judder"] = [1, 1, 1, 1, 0, 0]
    got = predict(table, textures=textures())
    spectrum = Spectrum.from_texture(textures()["noise"])
    display = Display(ppd=60, refresh_rate=60, luminance=100)
    for i, row in table.iterrows():
        parts = distortion(
            spectrum,
            display,
            Viewing(10),
            Shading(rate_x=0.5, mip_level=1),
            Parameters(ws=0, wt=0, beta=row["beta"]),
            components=Components(
                vrs=row["vrs"] == 1,
                eye_blur=row["eye_blur"] == 1,
                judder=row["judder"] == 1,
            ),
        )
        alone = got.loc[i]
        np.testing.assert_allclose(
            alone["spatial_distortion"], parts.spatial, rtol=rtol()
        )
        np.testing.assert_allclose(
            alone["temporal_distortion"], parts.temporal, rtol=rtol()
        )
    assert len(set(got["spatial_distortion"])) == 5
    assert got["spatial_distortion"][5] == 0 == got["quality_jnd"][5]


def test_the_table_is_kept_and_its_copy_extended():
    table = conditions(3).set_index(pd.Index(["x", "y", "x"]))
    table.insert(2, "note", ["a", None, 3])
    before = table.copy()
    got = predict(table, textures=textures())
    pd.testing.assert_frame_equal(table, before)
    pd.testing.assert_frame_equal(got[table.columns], before)
    added = ["spatial_distortion", "temporal_distortion", "quality_jnd"]
    assert list(got.columns) == [*table.columns, *added]
    assert set(got[added].dtypes) == {np.dtype(jnp.result_type(float))}


def test_no_rows_are_no_error():
    got = predict(conditions(2).iloc[:0])
    assert len(got) == 0 and "quality_jnd" in got


def test_the_order_of_rows_does_not_matter():
    table = conditions(9)
    order = np.random.default_rng(0).permutation(9)
    straight = predict(table, textures=textures())
    shuffled = predict(table.iloc[order], textures=textures())
    pd.testing.assert_frame_equal(shuffled.sort_index(), straight)


def test_each_texture_is_read_once_and_one_shape_serves_all(tmp_path, monkeypatch):
    read, shapes, done = [], [], []

    def image(path, read_image=_textures._image):
        read.append(path.name)
        return read_image(path)

    def recorded(spectrum, display, *rest, **options):
        shapes.append(display.ppd.shape)
        return distortion(spectrum, display, *rest, **options)

    monkeypatch.setattr(_textures, "_image", image)
    monkeypatch.setattr(_predict, "distortion", recorded)
    table = conditions(20)
    table["texture"] = ["a.npy"] + ["b.npy", "a.npy"] * 3 + ["b.npy"] * 13
    for name, texture in zip(("a.npy", "b.npy"), textures().values(), strict=True):
        write(tmp_path / name, texture)
    _predict.predictions(
        {name: list(table[name]) for name in table.columns},
        formulation=Formulation.RELEASED,
        parameters=Parameters.published(),
        textures={},
        encoding=None,
        folder=tmp_path,
        fidelity=Exact(),
        progress=done.append,
    )
    assert read == ["a.npy", "b.npy"]
    assert len(shapes) > 2 and len(set(shapes)) == 1
    assert sum(done) == 20


def test_rows_in_any_order_share_settings_on_other_rungs():
    table = conditions(40)
    table["rate_x"] = np.resize([1.0, 0.5, 0.5, 0.25], 40)
    table["rate_y"], table["mip_level"] = 1.0, 0.0
    exact = predict(table, textures=textures())
    pooled = predict(table, textures=textures(), fidelity=Pooled(5000))
    error = np.abs(pooled["quality_jnd"] - exact["quality_jnd"])
    assert 0 < error.max() < 0.02
    assert list(pooled["texture"]) == list(table["texture"])


@settings(deadline=None)
@given(st.lists(st.integers(1, 5000), min_size=1, max_size=50))
def test_padding_costs_less_than_it_saves(sizes):
    length = _predict._run_length(sizes)
    calls = sum(-(-size // length) for size in sizes)
    assert length in {2**k for k in range(9)}
    # Never worse than one call a row, of which each costs as much again.
    assert calls * (length + 1) <= 2 * sum(sizes)


@pytest.mark.parametrize(
    "column, bad, rule, make",
    [
        (
            "mean_luminance_cd_m2",
            0.0,
            "finite and > 0 cd/m^2, got 0",
            lambda x: Display(ppd=1, refresh_rate=1, luminance=x),
        ),
        (
            "refresh_rate_hz",
            -1.0,
            "finite and > 0 Hz, got -1",
            lambda x: Display(ppd=1, refresh_rate=x, luminance=1),
        ),
        (
            "ppd",
            np.inf,
            "finite and > 0 px/deg, got inf",
            lambda x: Display(ppd=x, refresh_rate=1, luminance=1),
        ),
        (
            "persistence",
            1.5,
            "in (0, 1], got 1.5",
            lambda x: Display(ppd=1, refresh_rate=1, luminance=1, persistence=x),
        ),
        ("velocity_deg_s", np.nan, "finite and >= 0 deg/s, got nan", Viewing),
        ("rate_x", 0.0, "in (0, 1], got 0", lambda x: Shading(rate_x=x)),
        ("rate_y", 2.0, "in (0, 1], got 2", lambda x: Shading(rate_y=x)),
        (
            "mip_level",
            -0.5,
            "finite and >= 0, got -0.5",
            lambda x: Shading(mip_level=x),
        ),
        ("vrs", 2.0, "0 or 1, got 2", lambda x: Components(vrs=x)),
        ("eye_blur", -1.0, "0 or 1, got -1", lambda x: Components(eye_blur=x)),
        ("judder", 0.5, "0 or 1, got 0.5", lambda x: Components(judder=x)),
        ("beta", 0.0, "> 0, got 0", lambda x: Parameters(ws=1, wt=1, beta=x)),
    ],
)
def test_cells_out_of_range_are_named_in_the_words_of_the_model(
    column, bad, rule, make
):
    table = pd.concat([one(**{column: 1.0}), one(**{column: bad})], ignore_index=True)
    with pytest.raises(TableError) as caught:
        predict(table, textures=textures())
    assert [problem.row for problem in caught.value.problems] == [1]
    assert f"`{column}` must be " in str(caught.value)
    assert rule in str(caught.value)
    with pytest.raises(ValueError) as alone:
        make(bad)
    assert rule in str(alone.value)


@pytest.mark.parametrize("cell", ["", "fast", "1_000", "nan", "0x10", None])
def test_cells_that_are_no_numbers(cell):
    table = pd.DataFrame([{**ROW, "velocity_deg_s": cell}], dtype=object)
    with pytest.raises(TableError, match=r"^row 0: `velocity_deg_s` must be finite"):
        predict(table, textures=textures())


def test_numbers_may_be_texts_and_flags_boolean():
    texts = pd.DataFrame([{k: str(v) for k, v in ROW.items()}])
    flags = one(vrs=True, judder=True)
    expected = predict(one(), textures=textures())["quality_jnd"]
    for table in (texts, flags):
        got = predict(table, textures=textures())["quality_jnd"]
        np.testing.assert_array_equal(got, expected)


@pytest.mark.parametrize("value", [1e300, 1e-40])
def test_numbers_beyond_single_precision(value):
    table = one(refresh_rate_hz=value)
    with jax.enable_x64(True):
        assert np.isfinite(predict(table, textures=textures())["quality_jnd"]).all()
    with jax.enable_x64(False), pytest.raises(TableError, match="> 0 Hz in float32"):
        predict(table, textures=textures())


def test_a_prediction_that_is_not_finite_is_an_error():
    table = pd.concat([one(beta=0.4), one(beta=1e6)])
    with pytest.raises(TableError, match="row 1: `quality_jnd` must be finite, got"):
        predict(table, textures=textures())


def test_all_problems_are_listed_by_row():
    table = conditions(4)
    table.loc[3, "ppd"] = 0
    table.loc[1, ["rate_x", "rate_y"]] = 3
    table.loc[2, "texture"] = "nowhere.png"
    with pytest.raises(TableError, match=r"^row 1: .*\(and 3 more\)$") as caught:
        predict(table, textures=textures())
    assert [problem.row for problem in caught.value.problems] == [1, 1, 2, 3]


def test_columns_that_are_missing_repeated_or_taken():
    table = conditions(2)
    with pytest.raises(TableError, match="must have the column `ppd`, got texture"):
        predict(table.drop(columns="ppd"))
    with pytest.raises(TableError, match="each column once, got `ppd` twice"):
        predict(pd.concat([table, table["ppd"]], axis=1))
    with pytest.raises(TableError, match="must not have the column `quality_jnd`"):
        predict(table.assign(quality_jnd=0.0))


# Textures


def difference(table, texture, **options):
    """How far the prediction for a table is from that for a given texture."""
    got = predict(table, **options)["quality_jnd"]
    same = predict(one(), textures={"noise": texture})["quality_jnd"]
    return float(abs(got / same - 1).max())


def test_builtin_textures_are_found_by_name():
    brick = builtin_textures()["brick"]
    assert difference(one(texture="builtin:brick"), brick) == 0
    with pytest.raises(TableError, match=r"one of builtin:brick, .* 'builtin:brik'"):
        predict(one(texture="builtin:brik"))


def test_encoding_leaves_textures_that_are_luminance_alone():
    brick = builtin_textures()["brick"]
    table = one(texture="builtin:brick")
    assert difference(table, brick, encoding="sRGB") == 0


def test_published_textures_are_found_by_name(real_data):
    real_data("jindal2021/Experiment_Data/vrs_exp_stimulus.mat")
    from camojab.datasets import jindal2021_textures

    grass = jindal2021_textures()["grass"]
    assert difference(one(texture="jindal2021:grass"), grass) == 0
    with pytest.raises(TableError, match="'jindal2021:moss'"):
        predict(one(texture="jindal2021:moss"))


def test_published_textures_that_cannot_be_had(monkeypatch, tmp_path):
    monkeypatch.setenv("CAMOJAB_DATA_DIR", str(tmp_path))
    with pytest.raises(TableError, match="row 0: .*vrs_exp_stimulus.mat.*download"):
        predict(one(texture="jindal2021:grass"))


@pytest.mark.parametrize("name", ["grey.png", "grey.tif", "grey.npy"])
def test_files_of_grey_are_luminance_as_they_stand(tmp_path, name):
    code = np.random.default_rng(1).integers(0, 256, (40, 50), dtype=np.uint8)
    write(tmp_path / name, code)
    assert difference(one(texture=str(tmp_path / name)), code / 255) < rtol()


def test_encoded_files_are_decoded(tmp_path):
    code = np.random.default_rng(1).integers(0, 256, (40, 50, 3), dtype=np.uint8)
    write(tmp_path / "colour.png", code)
    table = one(texture=str(tmp_path / "colour.png"))
    # IEC 61966-2-1, written out.
    v = code / 255
    linear = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    # The weights above are rounded to four digits.
    assert difference(table, luminance, encoding="sRGB") < 1e-3
    with pytest.raises(TableError, match=r"colour.png', `encoding` must be named"):
        predict(table)
    with pytest.raises(ValueError, match="`encoding` must be 'linear' or one of"):
        predict(table, encoding="video")


def test_relative_paths_are_sought_here_and_then_in_the_folder(tmp_path, monkeypatch):
    here, there = tmp_path / "here", tmp_path / "there"
    (here / "sub").mkdir(parents=True)
    (there / "sub").mkdir(parents=True)
    first, second = textures().values()
    write(there / "sub" / "a.npy", second)
    monkeypatch.chdir(here)
    table = one(texture=os.path.join("sub", "a.npy"))
    assert difference(table, second, folder=there) == 0
    write(here / "sub" / "a.npy", first)
    assert difference(table, first, folder=there) == 0
    (here / "sub" / "a.npy").unlink()
    with pytest.raises(TableError, match="must be a file, jindal2021:NAME or builtin"):
        predict(table)


@pytest.mark.parametrize(
    "name, content, message",
    [
        ("text.png", b"no image", "must be an image or an array that can be read"),
        ("empty.png", b"", "must be an image or an array that can be read"),
        ("empty.npy", b"", "must be an image or an array that can be read"),
        ("zip.npy", b"PK\x03\x04", "must be an image or an array that can be read"),
        ("object.npy", np.array([None]), "can be read (ValueError)"),
        ("nan.npy", np.full((2, 2), np.nan), "must be in [0, 1], got nan"),
        ("bright.npy", np.full((2, 2), 1.5), "must be in [0, 1], got 1.5"),
        ("none.npy", np.zeros((0, 4)), "at least one texel"),
        ("line.npy", np.zeros(4), "must have shape"),
        ("complex.npy", np.zeros((2, 2), complex), "must hold real numbers"),
    ],
)
def test_files_that_are_no_textures(tmp_path, name, content, message):
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        np.save(path, content, allow_pickle=True)
    table = pd.concat([one(), one(texture=str(path))], ignore_index=True)
    with pytest.raises(TableError) as caught:
        predict(table, textures=textures())
    assert str(caught.value).startswith(f"row 1: in {str(path)!r}, `texture` ")
    assert message in str(caught.value)


def test_all_broken_textures_are_reported(tmp_path):
    for name in ("a.npy", "b.npy"):
        write(tmp_path / name, np.zeros(3))
    paths = [str(tmp_path / name) for name in ("a.npy", "b.npy", "a.npy")]
    table = pd.concat([one(texture=path) for path in paths])
    with pytest.raises(TableError) as caught:
        predict(table)
    assert [problem.row for problem in caught.value.problems] == [0, 1]


def write(path, array):
    if path.suffix == ".npy":
        np.save(path, array)
    else:
        imsave(path, array, check_contrast=False)

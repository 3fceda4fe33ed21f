"""One's own experiment from two files: read as it is meant, or refused by line."""

import numpy as np
import pytest

from camojab import fit, TableError
from camojab._csv import read_csv


CONDITIONS = """\
condition,texture,rate_x,rate_y,mip_level,mean_luminance_cd_m2,refresh_rate_hz,\
velocity_deg_s,persistence,ppd,data_set,reference,day,room
half,brick.npy,0.5,1,2,100,60,10,1,50,rates,full,10.0,a
full,brick.npy,1,1,2,100,60,10,1,50,rates,full,10,a
full,brick.npy,1,1,2,100,60,20,1,50,rates,full,10,b
half,brick.npy,0.5,1,2,100,60,20,1,50,rates,full,10.0,b
"50 Hz",builtin:grass,1,1,0,100,50,10,0.5,50,refresh,50 Hz,30,a
"90 Hz",builtin:grass,1,1,0,100,90,10,0.5,50,refresh,50 Hz,30,a
"""
VOTES = """\
observer,day,room,condition_a,condition_b,a_preferred
ann,10,a,full,half,1
bob,10,a,half,full,true
ann,1e1,b,half,full,0
bob,30.0,a,90 Hz,50 Hz,1
"""


@pytest.fixture
def study(tmp_path):
    np.save(tmp_path / "brick.npy", np.random.default_rng(0).random((8, 8)))

    def read(votes=VOTES, conditions=CONDITIONS, **options):
        for name, text in (("votes.csv", votes), ("conditions.csv", conditions)):
            (tmp_path / name).write_text(text)
        read.folder = f"{tmp_path}/"
        return fit.read_comparisons(
            tmp_path / "votes.csv",
            tmp_path / "conditions.csv",
            **{"textures": tmp_path, **options},
        )

    return read


def problems(study, **files):
    """A sentence for each problem, which begins with the file it is about."""
    with pytest.raises(TableError) as caught:
        study(**files)
    return [line.replace(study.folder, "") for line in str(caught.value).splitlines()]


def test_a_study_is_read(study):
    found = study()
    table = found.table
    assert len(table) == 6
    # What both files have besides tells groups apart, however a number is written.
    groups = ["10, a", "10, a", "10, b", "10, b", "30, a", "30, a"]
    assert table["group"].tolist() == groups
    # Wherever the reference stands.
    assert table["reference"].tolist() == [1, 1, 2, 2, 4, 4]
    assert table["data_set"].tolist() == ["rates"] * 4 + ["refresh"] * 2
    assert table["block"].tolist() == table["data_set"].tolist()
    assert not table["temporal_only"].any()
    assert table["persistence"].tolist() == [1, 1, 1, 1, 0.5, 0.5]
    votes = found.votes
    assert votes["a"].tolist() == [1, 0, 3, 5] and votes["b"].tolist() == [0, 1, 2, 4]
    assert votes["a_preferred"].tolist() == [True, True, False, True]
    assert votes["group"].tolist() == ["10, a", "10, a", "10, b", "30, a"]
    assert votes["observer"].tolist() == ["ann", "bob", "ann", "bob"]
    assert set(found.textures) == {"brick.npy", "builtin:grass"}
    assert found.textures["brick.npy"].shape == (8, 8)


def test_what_may_be_left_out(study):
    few = "condition,texture,rate_x,rate_y,mip_level,mean_luminance_cd_m2,"
    few += "refresh_rate_hz,velocity_deg_s,persistence,ppd,temporal_only\n"
    few += "b,brick.npy,1,1,0,100,60,5,1,50,1\na,brick.npy,1,1,0,100,50,5,1,50,0\n"
    votes = "observer,condition_a,condition_b,a_preferred\n" + "x,a,b,1\n" * 2
    found = study(votes, few)
    assert found.table["group"].tolist() == ["all", "all"]
    assert found.table["reference"].tolist() == [0, 0]
    assert found.table["data_set"].tolist() == ["votes", "votes"]
    assert found.table["temporal_only"].tolist() == [True, False]
    assert found.votes["a"].tolist() == [1, 1]


def test_scaled_it_is_relative_to_its_references(study):
    more = "cid,10,b,full,half,1\ncid,30,a,50 Hz,90 Hz,0\neve,10,b,half,full,1\n"
    quality = fit.scaled(study(VOTES + more)).table["quality_jnd"].to_numpy()
    assert quality[1] == quality[2] == quality[4] == 0
    # One vote each way; two of three for full rate; both for 90 Hz.
    np.testing.assert_allclose(quality[0], 0, atol=1e-4)
    assert quality[3] < 0 < quality[5]


def test_a_condition_without_votes_cannot_be_scaled(study):
    more = '"70 Hz",builtin:grass,1,1,0,100,70,10,0.5,50,refresh,50 Hz,30,a\n'
    given = study(VOTES, CONDITIONS + more)
    with pytest.raises(
        ValueError, match="votes on every condition, .* '70 Hz' of 30, a"
    ):
        fit.scaled(given)


def test_unknown_conditions_of_votes_are_named(study):
    votes = VOTES.replace("half,full,0", "halve,full,0").replace("30.0,a", "10,a")
    # The last two are known, but in another group.
    assert problems(study, votes=votes) == [
        f"votes.csv, line {line}: `condition_{side}` must be a condition of "
        f"conditions.csv in {group}, got {name!r}."
        for line, side, group, name in (
            (4, "a", "10, b", "halve"),
            (5, "a", "10, a", "90 Hz"),
            (5, "b", "10, a", "50 Hz"),
        )
    ]


WRONG = {
    "repeated": (
        ("full,brick.npy,1,1,2,100,60,10", "half,brick.npy,1,1,2,100,60,10"),
        [
            "line 2: `reference` must be a condition of 10, a, got 'full'.",
            "line 3: `condition` must be unique, got 'half' again in 10, a.",
            "line 3: `reference` must be a condition of 10, a, got 'full'.",
        ],
    ),
    "bad number": (
        ("half,brick.npy,0.5,1,2,100,60,20", "half,brick.npy,0.5,1,2,bright,60,20.0"),
        ["line 5: `mean_luminance_cd_m2` must be finite and > 0 cd/m^2, got 'bright'."],
    ),
    "out of range": (
        ("grass,1,1,0,100,90,10,0.5", "grass,1,1,0,100,90,10,1.5"),
        ["line 7: `persistence` must be in (0, 1], got 1.5."],
    ),
    "unknown reference": (
        ('refresh,50 Hz,30,a\n"90', 'refresh,60 Hz,30,a\n"90'),
        ["line 6: `reference` must be a condition of 30, a, got '60 Hz'."],
    ),
    "ragged": (
        ("50,rates,full,10,b\nhalf", "50,rates,full,10\nhalf"),
        ["line 4: must have 14 cells, as the header, got 13."],
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_conditions_are_named_by_line(study, name):
    (old, new), expected = WRONG[name]
    assert old in CONDITIONS
    found = problems(study, conditions=CONDITIONS.replace(old, new, 1))
    assert found == [f"conditions.csv, {line}" for line in expected]


def test_every_problem_is_told_at_once(study):
    wrong = CONDITIONS.replace("0.5,1,2", "2,1,2")
    found = problems(study, conditions=wrong)
    assert found == [
        f"conditions.csv, line {line}: `rate_x` must be in (0, 1], got 2."
        for line in (2, 5)
    ]


def test_missing_columns_are_named(study):
    (found,) = problems(study, conditions=CONDITIONS.replace(",ppd", ",pixels"))
    assert found.startswith(
        "conditions.csv: the table must have the column `ppd`, got condition, texture"
    )
    (found,) = problems(study, votes=VOTES.replace("observer", "person"))
    assert found.startswith(
        "votes.csv, line 1: the table must have the column `observer`"
    )


def test_textures_that_are_not_there_are_named(study, tmp_path):
    wrong = CONDITIONS.replace("half,brick.npy", "half,brock.npy")
    first, *more = problems(
        study, conditions=wrong.replace("builtin:grass", "builtin:x")
    )
    assert first.startswith("conditions.csv, line 2: `texture` must be a file")
    assert "'brock.npy'" in first
    assert len(more) == 1 and "line 6: `texture` must be one of builtin:" in more[0]
    (tmp_path / "brock.npy").write_text("no array")
    (found,) = problems(study, conditions=wrong)
    assert found.startswith("conditions.csv, line 2: in 'brock.npy', `texture` must be")


def test_there_must_be_conditions(study):
    (found,) = problems(study, conditions=CONDITIONS.splitlines()[0] + "\n")
    assert found == "conditions.csv: must have conditions, got none."


def test_a_column_that_is_made_here_is_refused(study):
    (found,) = problems(study, conditions=CONDITIONS.replace("room", "group"))
    assert "`group`" in found and found.startswith("conditions.csv: ")


def test_files_that_are_not_there(tmp_path):
    (tmp_path / "votes.csv").write_text(VOTES)
    with pytest.raises(FileNotFoundError, match="nowhere.csv"):
        fit.read_comparisons(tmp_path / "nowhere.csv", tmp_path / "conditions.csv")
    with pytest.raises(FileNotFoundError, match="conditions.csv"):
        fit.read_comparisons(tmp_path / "votes.csv", tmp_path / "conditions.csv")


# ---- files of cells


def written(tmp_path, content):
    path = tmp_path / "table.csv"
    path.write_bytes(content)
    return path


def test_cells_and_lines(tmp_path):
    path = written(tmp_path, b'\xef\xbb\xbfa,b\r\n1,"two\nlines"\r\n\r\n3,4\r\n')
    table = read_csv(path)
    assert table.header == ["a", "b"]
    assert table.rows == [["1", "two\nlines"], ["3", "4"]] and table.lines == [2, 5]
    assert table.columns(["b", "c"]) == {"b": ["two\nlines", "4"]}


@pytest.mark.parametrize(
    "content, message",
    [
        (b"", ": must begin with the names of the columns."),
        (b"a,b\n1,2\n3\n", ", line 3: must have 2 cells, as the header, got 1."),
        (b"a\n1\n2,3\n", ", line 3: must have 1 cell, as the header, got 2."),
        (b'a,b\n1,"2"x\n', ", line 2: must be CSV ("),
        (b"a,b\n1,\xff\n", ": must be text in UTF-8 ("),
    ],
)
def test_wrong_files_are_named(tmp_path, content, message):
    path = written(tmp_path, content)
    with pytest.raises(TableError) as caught:
        read_csv(path)
    assert str(caught.value).startswith(f"{path}{message}")

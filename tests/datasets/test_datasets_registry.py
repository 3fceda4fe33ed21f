import hashlib
import subprocess
import sys

import pooch
import pytest

from camojab.datasets import _registry, fetch, MissingData


NAME = "denes2020/data/exp1_scaled_results.csv"
URL = (
    "https://raw.githubusercontent.com/gfxdisp/motion_quality_20/"
    "c244ea6c94aa7834b780a1a5abe145727bf08d4a/data/exp1_scaled_results.csv"
)
GOOD = b"a,b\n1,2\n"
SHA256 = hashlib.sha256(GOOD).hexdigest()
BAD = b"something else"
BAD_SHA256 = hashlib.sha256(BAD).hexdigest()


@pytest.fixture(autouse=True)
def registry_of_one_known_file(monkeypatch):
    monkeypatch.setattr(_registry, "_SHA256", {NAME: SHA256, "denes2020/LICENSE": "0"})


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("CAMOJAB_DATA_DIR", str(tmp_path / "data"))
    return tmp_path / "data"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.delenv("CAMOJAB_DATA_DIR", raising=False)
    monkeypatch.setattr(pooch, "os_cache", lambda project: tmp_path / project)
    return tmp_path / "camojab"


def put(folder, content):
    path = folder / NAME
    path.parent.mkdir(parents=True)
    path.write_bytes(content)
    return path


class Network:
    """Stands for the downloader: serves `content`, or is down if that is None."""

    def __init__(self, monkeypatch, content):
        self.asked = []
        self.content = content
        monkeypatch.setattr(pooch, "HTTPDownloader", lambda: self)

    def __call__(self, url, output_file, registry):
        self.asked.append(url)
        if self.content is None:
            raise ConnectionError("no network\nand a long story")
        with open(output_file, "wb") as file:
            file.write(self.content)


def files(folder):
    return [path for path in folder.rglob("*") if path.is_file()]


def assert_one_line_with(message, *parts):
    assert message.endswith(".") and ". " not in message and "\n" not in message
    for part in parts:
        assert part in message


def test_unknown_name_lists_the_nearest():
    with pytest.raises(ValueError, match="`name` must be a file of the reg") as error:
        fetch("denes2020/exp1_scaled_results.csv")
    assert_one_line_with(str(error.value), "nearest are " + NAME)


def test_folder_of_the_environment_is_read_and_nothing_else(folder, monkeypatch):
    network = Network(monkeypatch, GOOD)
    path = put(folder, GOOD)
    assert fetch(NAME) == path
    assert files(folder) == [path]
    assert not network.asked


def test_missing_from_the_folder_is_not_downloaded(folder, monkeypatch):
    network = Network(monkeypatch, GOOD)
    with pytest.raises(MissingData) as error:
        fetch(NAME)
    assert_one_line_with(str(error.value), NAME, URL, str(folder / NAME))
    assert not network.asked and not folder.exists()


def test_wrong_checksum_in_the_folder_is_an_error_and_the_file_is_left(folder):
    path = put(folder, BAD)
    with pytest.raises(ValueError) as error:
        fetch(NAME)
    assert_one_line_with(str(error.value), NAME, SHA256, BAD_SHA256, str(path), URL)
    assert path.read_bytes() == BAD


def test_downloads_once_and_silently_to_the_cache(cache, monkeypatch, capsys):
    network = Network(monkeypatch, GOOD)
    assert fetch(NAME) == fetch(NAME) == cache / NAME
    assert (cache / NAME).read_bytes() == GOOD
    assert network.asked == [URL]
    assert capsys.readouterr().out == ""


def test_neither_file_nor_network(cache, monkeypatch):
    Network(monkeypatch, None)
    with pytest.raises(MissingData) as error:
        fetch(NAME)
    message = str(error.value)
    assert_one_line_with(message, NAME, URL, str(cache / NAME), "CAMOJAB_DATA_DIR")
    assert files(cache) == []


def test_wrong_checksum_of_a_download_is_an_error_and_not_kept(cache, monkeypatch):
    Network(monkeypatch, BAD)
    with pytest.raises(ValueError) as error:
        fetch(NAME)
    assert_one_line_with(str(error.value), NAME, SHA256, BAD_SHA256, URL)
    assert files(cache) == []


def test_wrong_checksum_in_the_cache_is_an_error(cache, monkeypatch):
    network = Network(monkeypatch, GOOD)
    path = put(cache, BAD)
    with pytest.raises(ValueError) as error:
        fetch(NAME)
    assert_one_line_with(str(error.value), NAME, SHA256, BAD_SHA256, str(path))
    assert not network.asked


def test_empty_variable_means_the_cache(cache, monkeypatch):
    monkeypatch.setenv("CAMOJAB_DATA_DIR", "")
    path = put(cache, GOOD)
    assert fetch(NAME) == path


def test_import_is_light():
    heavy = ["colour", "jax", "matplotlib", "OpenEXR", "pandas", "pooch", "skimage"]
    code = f"""
import sys, camojab.datasets
assert not [name for name in {heavy} if name in sys.modules]
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_every_published_file_has_its_checksum(real_data, monkeypatch):
    monkeypatch.undo()
    assert len(_registry._SHA256) == 22
    real_data(*_registry._SHA256)

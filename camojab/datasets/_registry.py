"""Public files by name: where each comes from, what it must contain, where it is."""

import difflib
import hashlib
import os
from pathlib import Path
from typing import Any, cast


_ROOTS = {
    "jindal2021": "gfxdisp/ALSaRR/d06b3e02526d8cfa9a094c8223b115076703d29f",
    "denes2020": "gfxdisp/motion_quality_20/c244ea6c94aa7834b780a1a5abe145727bf08d4a",
    "stelacsf": "gfxdisp/stelaCSF/052b15e7ace33d5bacc30cc346be1dd91b2d5ef7",
}

_SHA256 = {
    "denes2020/LICENSE": (
        "869bd4d7e1236bff421c0c201442aaee17a52e37c32d075e94ded89ef5ab8d69"
    ),
    "denes2020/data/exp1_scaled_results.csv": (
        "46a1980e1d8ff1d94186cc5f7c2630bbe3a5a28330eca0d052585292d2c54e28"
    ),
    "denes2020/data/pairwise_comparison_matrices.mat": (
        "aded88e6d88907898ff576f2bb316a238f82819e42b0814bbf0eb91cc948b964"
    ),
    "jindal2021/ALSaRR/sample_data/all_polynomials.zip": (
        "752c2e19b3219c169c8108e43ab83dc5f1b82fb0d67be9bdab2b91faf9525d10"
    ),
    "jindal2021/ALSaRR/sample_data/materials_n.exr": (
        "89fc8e02b9bd360a92e1b17b49cd5d70f67e6233a81fe2f950db71a827c8ab2b"
    ),
    "jindal2021/ALSaRR/sample_data/motion_n.exr": (
        "5ee73f80bd5f278cce217040cc458ae117ef1711e28034da512f386973d39c81"
    ),
    "jindal2021/ALSaRR/sample_data/scene_snapshot.png": (
        "b1a6909668866914171b3bc5aa425866b94d2c984060776fe448189c64621ea6"
    ),
    "jindal2021/CaMoJAB/camojab_fits.mat": (
        "0a4d0969ae08199f4191f2d13029fd11c75ca0e0997351efe5d9c61722db3b7b"
    ),
    "jindal2021/CaMoJAB/sample_texture.png": (
        "5aea0dc4a43a55a2e33824a49ae57ed6657de1878a01fa04ce2da2807c275732"
    ),
    "jindal2021/Experiment_Data/alsarr_validation_experiment.csv": (
        "69eb9e487b983c4e3234187f0037cd90bd402306ab72bba8b84377514481a328"
    ),
    "jindal2021/Experiment_Data/external_data/marrr_exp1_confidence75.mat": (
        "22f03430cb79b72ec11cdeb399ce05282b5f4751a95b9860f9412bf1b02cfe94"
    ),
    "jindal2021/Experiment_Data/external_data/marrr_exp1_jnds.mat": (
        "ca4052826c3589b20eb7586fa815771b69ecc4cd03ece14a8541cfaa1f22939c"
    ),
    "jindal2021/Experiment_Data/external_data/marrr_exp3_jnds.mat": (
        "3425871ad5969d432953c3543816cb0c7dec76eebf0650f21e80f895732a6433"
    ),
    "jindal2021/Experiment_Data/vrs_exp_data.csv": (
        "486622b0282628dc4c4cb5701e7f440f96b070c59ed595f16bfbf9562c9a61e2"
    ),
    "jindal2021/Experiment_Data/vrs_exp_data_jnd.mat": (
        "9202fa445ed0a8c3bc549e0d2494568ec31f241a94040f8e4de1aca7799c5b0b"
    ),
    "jindal2021/Experiment_Data/vrs_exp_stimulus.mat": (
        "b4c05300935de4028ccfbd363732a27d040fc70b2e29a86edd39c638fb0c1003"
    ),
    "jindal2021/LICENSE": (
        "2b887f5c17cc44c7a1f8a5001092c8e1b9c06cd92625e5081f7f4a1935db0468"
    ),
    "stelacsf/LICENSE.md": (
        "32a30b612970fc706b41a816dc1b08db085bc8aa11ae588b2a4be97136c15cf9"
    ),
    "stelacsf/data/backgrounds.csv": (
        "5052e1ea09d2ea0480bb82b5ce627929f62665203c8677540b4bb44904b0e522"
    ),
    "stelacsf/data/color_directions.csv": (
        "933d56e3cc26b7ef0b438a16e71f3ae48ee0d18f712d4f74bb6d1f204e4467b7"
    ),
    "stelacsf/data/data_aggregated.csv": (
        "69f95ffb2351593a4a0a26414bef282a0974dd00c89b882688c4b7c542f0b505"
    ),
    "stelacsf/data/datasets.json": (
        "fc6883b0108a790555ef3c5de85253dc08517b7d7a64cd975b9b7225fd823adf"
    ),
}


class MissingData(FileNotFoundError):
    """A public file is not on this machine and could not be downloaded either."""


def fetch(name: str) -> Path:
    """Path of a public data file on this machine, checked against its SHA-256.

    If the environment variable `CAMOJAB_DATA_DIR` is set, the file is read from that
    folder, which is never written to. Otherwise it is read from the user's cache
    (`pooch.os_cache("camojab")`), to which it is downloaded first if it is not there.

    **Arguments:**

    - `name`: the name of the data set, then the file's path in the repository of its
        authors, such as `"jindal2021/Experiment_Data/vrs_exp_data.csv"`.

    **Returns:** the path of the file, the same below either folder.

    **Raises:** `ValueError` for a name that is not in the registry (the message lists
    the nearest) and for a file whose SHA-256 is not the published one (the message
    gives both); `MissingData` if there is neither file nor network (the message says
    where to get the file and where to put it).

    **Source:** three repositories under the MIT licence, each at one commit:
    `jindal2021/` is gfxdisp/ALSaRR (Jindal et al. 2021, doi:10.1145/3478513.3480514),
    `denes2020/` is gfxdisp/motion_quality_20 (Denes et al. 2020,
    doi:10.1145/3386569.3392411), `stelacsf/` is gfxdisp/stelaCSF (Mantiuk et al. 2022,
    doi:10.1145/3528223.3530115).
    """
    if name not in _SHA256:
        near = ", ".join(difflib.get_close_matches(name, _SHA256, n=3, cutoff=0))
        raise ValueError(
            f"`name` must be a file of the registry, got {name!r}; the nearest are "
            f"{near}."
        )
    folder = os.environ.get("CAMOJAB_DATA_DIR")
    return _from_folder(name, Path(folder)) if folder else _from_cache(name)


def _url(name: str) -> str:
    root, path = name.split("/", 1)
    return f"https://raw.githubusercontent.com/{_ROOTS[root]}/{path}"


def _from_folder(name: str, folder: Path) -> Path:
    path = folder / name
    if not path.is_file():
        raise MissingData(
            f"`{name}` is missing from the folder that CAMOJAB_DATA_DIR names: "
            f"download {_url(name)} to {path}, or unset the variable to have it "
            "downloaded."
        )
    _verify(name, path, f"replace {path} by {_url(name)}")
    return path


def _from_cache(name: str) -> Path:
    import pooch

    cache = Path(pooch.os_cache("camojab"))
    path = cache / name
    if path.is_file():
        _verify(name, path, f"delete {path} to have it downloaded again")
        return path
    registry = pooch.create(
        path=cache, base_url="", registry=_SHA256, urls={n: _url(n) for n in _SHA256}
    )

    def download(url: str, output_file: str, registry: pooch.Pooch) -> None:
        pooch.HTTPDownloader()(url, output_file, registry)
        _verify(name, Path(output_file), f"{url} was downloaded and not kept")

    try:
        # pooch passes these three by position, but its type has other names for them.
        return Path(registry.fetch(name, downloader=cast(Any, download)))
    except OSError as error:
        raise MissingData(
            f"`{name}` is not in the cache and could not be downloaded "
            f"({type(error).__name__}): download {_url(name)} to {path}, or set "
            "CAMOJAB_DATA_DIR to a folder that has it."
        ) from error


def _verify(name: str, path: Path, remedy: str) -> None:
    found = hashlib.sha256(path.read_bytes()).hexdigest()
    if found != _SHA256[name]:
        raise ValueError(
            f"`{name}` must have the SHA-256 {_SHA256[name]}, found {found}: {remedy}."
        )

"""Where the files that travel with the package are."""

from pathlib import Path


def shipped(name: str) -> Path:
    """Path of a file of the project's `data` folder, installed or in a checkout."""
    package = Path(__file__).parent
    installed = package / "data" / name
    return installed if installed.exists() else package.parent / "data" / name

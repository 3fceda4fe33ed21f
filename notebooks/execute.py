"""Execute notebooks from top to bottom and store what they print and draw.

Without arguments every notebook beside this file. What is stored is of the built-in
data; of the machine there is nothing in it but how fast that was, in the last notebook.
"""

import os
import sys
from pathlib import Path

import nbclient
import nbformat
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import KernelManager


FOLDER = Path(__file__).parent
METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}


def main(paths: list[str]) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "CAMOJAB_DATA_DIR"}
    for path in map(Path, paths) if paths else sorted(FOLDER.glob("*.ipynb")):
        print(path.name, flush=True)
        notebook = nbformat.read(path, as_version=4)
        execute(notebook, path.parent, environment)
        notebook.metadata = nbformat.from_dict(METADATA)
        part = path.with_suffix(".part")
        nbformat.write(notebook, part)
        os.replace(part, path)


def execute(
    notebook: nbformat.NotebookNode,
    folder: Path,
    environment: dict[str, str],
    *,
    timeout: int = 600,
    connection_file: str = "",
) -> None:
    """Execute in a kernel of this very Python, whatever kernels are installed.

    **Arguments:** `timeout`: of each cell. [s]. `connection_file`: where the kernel's
    is written, in the place of the user's folder.

    **Raises:** `nbclient.exceptions.CellExecutionError` for a cell that fails.
    """
    manager = KernelManager(
        kernel_spec_manager=KernelSpecManager(kernel_dirs=[]),
        connection_file=connection_file,
    )
    client = nbclient.NotebookClient(
        notebook,
        km=manager,
        timeout=timeout,
        record_timing=False,
        resources={"metadata": {"path": str(folder)}},
    )
    client.execute(env=environment, cleanup_kc=True)


if __name__ == "__main__":
    main(sys.argv[1:])

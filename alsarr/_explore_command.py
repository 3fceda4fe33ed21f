"""`alsarr explore`: the model under sliders, in a browser on this machine."""

import threading
import webbrowser
from contextlib import ExitStack
from typing import Annotated

import typer

from camojab import _command as command


# What the library calls the options.
_OPTIONS = {"`port`": "`--port`"}


def explore(
    port: Annotated[
        int,
        typer.Option(min=0, max=65535, help="To listen on; 0 for any that is free."),
    ] = 5006,
    browser: Annotated[
        bool,
        typer.Option("--browser/--no-browser", help="Open the page in a browser."),
    ] = True,
) -> None:
    """Move velocity, rates and displays, and see quality, spectra and rate maps.

    A web page at 127.0.0.1, which other machines cannot reach; Ctrl-C ends it.
    Textures are those that are built in, those of Jindal et al. 2021 where they are on
    this machine already, and any image, which stays in memory. Needs
    alsarr[explore].
    """
    with command.usable(_OPTIONS), ExitStack() as until_ready:
        from .explore import serve

        progress = until_ready.enter_context(command.stages())

        def ready(address: str) -> None:
            until_ready.close()
            print(f"explorer at {address}, Ctrl-C ends it", flush=True)
            if browser:
                # Browsers of the console return only when they are left.
                opening = {"target": webbrowser.open, "args": (address,)}
                threading.Thread(**opening, daemon=True).start()

        serve(port=port, ready=ready, progress=progress)

"""A page of this machine alone: viser's server, quiet and without its public addresses."""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from types import ModuleType
from typing import TYPE_CHECKING

from part2gs_robotics.errors import ConfigError

if TYPE_CHECKING:
    import viser

HOST = "127.0.0.1"  # this machine alone: what is served has no password


def open_page(port: int) -> tuple[viser.ViserServer, str]:
    """Return a running server and its address.

    Args:
        port: wanted; the next free one where it is taken.

    Raises:
        ConfigError: viser is not installed.
    """
    library = _viser()
    with redirect_stdout(io.StringIO()):  # its banner, printed whatever `verbose` says
        server: viser.ViserServer = library.ViserServer(host=HOST, port=port, verbose=False)
    # A page may ask viser for a public address; this machine alone is meant.
    server.request_share_url = lambda verbose=True: None
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    return server, f"http://{HOST}:{server.get_port()}"


def close_page(server: viser.ViserServer) -> None:
    """Stop a server."""
    with redirect_stdout(io.StringIO()):
        server.stop()


def _viser() -> ModuleType:
    try:
        import viser
    except ImportError:
        raise ConfigError("viser is not installed, which shows a twin in the browser; run "
                          "pip install 'part2gs-robotics[view]' (or pip install '.[view]' in a "
                          "checkout).") from None
    return viser

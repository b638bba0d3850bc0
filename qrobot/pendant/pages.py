"""The pages of the pendant. The one door of NiceGUI: it serves them, and brings three.js along.

A page is one document with tabs, so that it keeps its connection, and with it the lease, from one to the next. What is
on it is drawn by `web/`; NiceGUI gives the frame.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Final

from fastapi import FastAPI
from nicegui import ui
from nicegui.element import Element

WEB: Final = Path(__file__).parent / "web"
TITLE: Final = "QRobot pendant"
RECONNECT_S: Final = 60.0  # [A] a page that was away for longer is loaded again, and loses what it shows


def _three() -> Path:
    """Folder of three.js, as NiceGUI brings it for its scene."""
    spec = find_spec("nicegui")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent / "elements" / "scene" / "dist"


class Panel(
    Element, component="web/panel.js", esm={"nicegui-scene": str(_three()), "qrobot-pendant": str(WEB / "station")}
):
    """A part of a page that `web/station` draws.

    Args:
        kind: which one, see `web/station/index.js`.
    """

    def __init__(self, kind: str) -> None:
        super().__init__()
        self._props["kind"] = kind
        self.classes(f"panel panel-{kind}")


def _page() -> None:
    """One document; all tabs are made at once and shown in turn."""
    ui.add_head_html('<link rel="stylesheet" href="/pendant-web/uPlot-1.6.32.min.css">')
    ui.add_head_html('<script src="/pendant-web/uPlot-1.6.32.iife.min.js"></script>')
    ui.add_css(WEB / "pendant.css")
    Panel("bar")
    Panel("tabs")


def add_pages(app: FastAPI) -> None:
    """Serve the pages with an application of FastAPI."""
    from fastapi.staticfiles import StaticFiles

    app.mount("/pendant-web", StaticFiles(directory=WEB / "vendor"))
    ui.run_with(
        app,
        root=_page,
        title=TITLE,
        dark=None,
        reconnect_timeout=RECONNECT_S,
        show_welcome_message=False,
        tailwind=False,
    )

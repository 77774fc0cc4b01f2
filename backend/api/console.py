"""The console's files, where it is built."""

from __future__ import annotations

from pathlib import Path

from fastapi import FastAPI
from fastapi.responses import HTMLResponse
from starlette.staticfiles import StaticFiles

NOT_BUILT = """<!doctype html><meta charset="utf-8"><title>Pilotage</title>
<h1>The console is not built</h1>
<p>The station runs; its API is under <a href="/openapi.json">/openapi.json</a>. To build the console run
<code>make setup</code> (or <code>npm ci &amp;&amp; npm run build</code> in <code>frontend/</code>) and reload.</p>
"""


def default_console_dir() -> Path:
    """Where the build of the checkout lies."""
    return Path(__file__).resolve().parents[2] / "frontend" / "dist"


def add_console(app: FastAPI, folder: Path) -> bool:
    """Serve the console; a page that says how to build it where there is none. Returns whether there is one."""
    if (folder / "index.html").is_file():
        app.mount("/", StaticFiles(directory=folder, html=True), name="console")
        return True

    @app.get("/", include_in_schema=False)
    async def not_built() -> HTMLResponse:
        return HTMLResponse(NOT_BUILT, status_code=503)

    return False

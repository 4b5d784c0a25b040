"""The page `/docs`: the OpenAPI document as Swagger UI shows it, without any other host."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Literal

from fastapi import APIRouter
from starlette.responses import FileResponse, Response

router = APIRouter(include_in_schema=False)

FOLDER = FilePath(__file__).parent / "swagger_ui"
_MEDIA = {".html": "text/html", ".js": "text/javascript", ".css": "text/css"}
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; frame-ancestors 'none'"
)
"""Swagger UI sets styles of elements and has its icons as data; scripts are files alone."""

Asset = Literal["swagger-ui-bundle.js", "swagger-ui.css", "start.js"]


@router.get("/docs")
async def page() -> Response:
    """Return the page."""
    return _file("index.html")


@router.get("/docs/{asset}")
async def asset(asset: Asset) -> Response:
    """Return a script or a style sheet of the page.

    Parameters
    ----------
    asset
        Name of the file.

    Returns
    -------
    Response
        The file.
    """
    return _file(asset)


def _file(name: str) -> Response:
    path = FOLDER / name
    headers = {"Content-Security-Policy": _POLICY}
    return FileResponse(path, media_type=_MEDIA[path.suffix], headers=headers)

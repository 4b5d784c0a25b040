"""The page of every route, from the service's own OpenAPI document."""

from __future__ import annotations

from http import HTTPStatus
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from jinja2 import Environment, FileSystemLoader

from ssil_service import embed

TITLES = {
    "datasets": "Datasets",
    "runs": "Runs",
    "questions": "Queries",
    "queries": "Queries",
    "jobs": "Jobs",
    "inference": "Open Inference Protocol",
    "operation": "Operation",
}
"""Tag of the document → heading of the page, in this order."""


def read_document() -> dict[str, Any]:
    """Return the OpenAPI document that a service on an empty store answers with."""
    with TemporaryDirectory() as folder, embed(folder) as store:
        return store.connection.json("GET", "openapi.json")


def render(document: dict[str, Any]) -> str:
    """Return the page, Markdown: the routes by tag, and then the schemas that they name."""
    groups: dict[str, list[dict[str, Any]]] = {title: [] for title in TITLES.values()}
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            tag: str = operation["tags"][0]
            title = TITLES.get(tag, tag.capitalize())
            row = {"method": method.upper(), "path": path, "operation": operation}
            groups.setdefault(title, []).append(row)
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,
    )
    environment.filters |= {"type": describe_type, "cell": _cell, "status": _status}
    template = environment.get_template("rest.md.j2")
    return template.render(
        groups={title: rows for title, rows in groups.items() if rows},
        schemas=document["components"]["schemas"],
        info=document["info"],
    )


def describe_type(schema: dict[str, Any]) -> str:
    """Return what a schema allows, in a few words, with links to the schemas of this page."""
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[-1]
        return f"[{name}](#{name.lower()})"
    for kind in ("anyOf", "oneOf"):
        if kind in schema:
            return " or ".join(dict.fromkeys(describe_type(one) for one in schema[kind]))
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return " or ".join(f"`{value}`" for value in schema["enum"])
    kind = schema.get("type", "anything")
    if isinstance(kind, list):
        return " or ".join(kind)
    if kind == "array":
        return f"list of {describe_type(schema.get('items', {}))}"
    if kind == "string" and schema.get("format") == "binary":
        return "bytes"
    return f"{kind}{_describe_range(schema)}"


def _describe_range(schema: dict[str, Any]) -> str:
    """Return the bounds of a number, as ` ≥ 0, ≤ 256`."""
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    bounds = [f"{sign} {schema[name]:g}" for name, sign in signs.items() if name in schema]
    return f" {', '.join(bounds)}" if bounds else ""


def _cell(text: str | None) -> str:
    """Return text that may stand in a cell of a Markdown table."""
    return (text or "").replace("\n", " ").replace("|", "\\|").strip()


def _status(code: str) -> str:
    """Return a status code with its name."""
    return f"{code} {HTTPStatus(int(code)).phrase}" if code.isdigit() else code

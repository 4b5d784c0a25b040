"""The page of the service's settings, from their class."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

from jinja2 import Environment, FileSystemLoader

from ssil_service.settings import Settings

SECRET = ("read_key", "write_key")
"""Settings that are read from the environment only: a command line is seen by other users."""


def render() -> str:
    """Return the page, Markdown: one row per setting."""
    texts = _read_docstrings()
    rows = [
        {
            "flag": "" if name in SECRET else f"--{name.replace('_', '-')}",
            "variable": f"SSIL_{name.upper()}",
            "default": _show_default(name),
            "help": texts[name],
        }
        for name in Settings.model_fields
    ]
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), trim_blocks=True, autoescape=False
    )
    return environment.get_template("settings.md.j2").render(rows=rows)


def _show_default(name: str) -> str:
    field = Settings.model_fields[name]
    if name == "jobs":
        return "one per core"
    if name == "state":
        return "`.service` in the store"
    value = field.default
    if value is None:
        return "none"
    if isinstance(value, int) and value >= 2**20 and value % 2**20 == 0:
        size = f"{value // 2**30} GiB" if value % 2**30 == 0 else f"{value // 2**20} MiB"
        return f"{value} ({size})"
    return str(value)


def _read_docstrings() -> dict[str, str]:
    """Return the string below each field of the class, as its source has it."""
    (body,) = ast.parse(inspect.getsource(Settings)).body
    assert isinstance(body, ast.ClassDef)
    found = {}
    for field, text in zip(body.body, body.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
            assert isinstance(field.target, ast.Name)
            found[field.target.id] = ast.literal_eval(text.value)
    return found

"""Filling a page's template: everything is escaped, scripts and styles become part of the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import altair as alt
import vl_convert
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

HERE = Path(__file__).parent
MINUS = "\N{MINUS SIGN}"


def render(
    context: Mapping[str, Any],
    *,
    folder: Path = HERE,
    filters: Mapping[str, Callable[..., str]] = MappingProxyType({}),
) -> str:
    """Return the page of a folder's template `page.html.j2`, with its `page.js`.

    Parameters
    ----------
    context
        Values of the template.
    folder
        Folder of the template; its `page.css` is added to the report's.
    filters
        More filters of the template, which may replace the report's.
    """
    environment = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    environment.filters |= {
        "count": "{:,}".format,
        "number": _number,
        "percent": _percent,
        "short": _short,
        **filters,
    }
    styles = [(each / "page.css").read_text("utf-8") for each in dict.fromkeys((HERE, folder))]
    return environment.get_template("page.html.j2").render(
        context,
        style=Markup("\n".join(styles)),
        script=Markup((folder / "page.js").read_text("utf-8")),
        bundle=Markup(_bundle()),
    )


@cache
def _bundle() -> str:
    """Return Vega, Vega-Lite and Vega-Embed, of the version that the charts are written for."""
    version = ".".join(alt.SCHEMA_VERSION.removeprefix("v").split(".")[:2])
    bundle = vl_convert.javascript_bundle("window.vegaEmbed = vegaEmbed;", vl_version=version)
    return bundle.replace("</script", "<\\/script")


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}".replace("-", MINUS)


def _percent(share: float) -> str:
    return f"{share:.0%}".replace("%", "\N{NO-BREAK SPACE}%")


def _short(value: float) -> str:
    """Return a number to three digits."""
    text = f"{value:,.0f}" if 1e3 <= abs(value) < 1e9 else f"{value:#.3g}".rstrip(".")
    return text.replace("-", MINUS)

"""MkDocs hook: pages that are made when the manual is built, so that none can be out of date.

Commands come from the command line's own help, routes and schemas from the service's OpenAPI
document, settings from their class; changelog, contributing, security and benchmarks are the
files of the repository.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from mkdocs.utils import get_relative_url

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(HERE))

import commands  # noqa: E402
import rest  # noqa: E402
import settings  # noqa: E402

REPOSITORY_FILES = {
    "benchmarks.md": "benchmarks/README.md",
    "project/changelog.md": "CHANGELOG.md",
    "project/contributing.md": "CONTRIBUTING.md",
    "project/security.md": "SECURITY.md",
}
"""Page of the manual → file of the repository that it shows."""
SHIM = "https://unpkg.com/iframe-worker/shim"
LOCAL_SHIM = "vendor/iframe-worker/shim.js"
"""iframe-worker 1.0.4, with its license beside it: search needs it where pages are files."""


def on_files(files: Files, config: MkDocsConfig, **_: Any) -> Files:
    """Add the generated pages to those of the folder."""
    document = rest.read_document()
    pages = {
        "reference/commands.md": commands.render(),
        "reference/rest.md": rest.render(document),
        "reference/settings.md": settings.render(),
    }
    for page, path in REPOSITORY_FILES.items():
        pages[page] = _plain_links((ROOT / path).read_text(encoding="utf-8"))
    for page, content in pages.items():
        files.append(File.generated(config, page, content=content))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Lead links to the repository's benchmarks to the page that shows them."""
    here = get_relative_url("benchmarks.md", page.file.src_uri)
    return re.sub(r"\]\((?:\.\./)+benchmarks/README\.md", f"]({here}", markdown)


def on_post_page(output: str, page: Page, **_: Any) -> str:
    """Load the script that searches in files from the site itself."""
    return output.replace(SHIM, get_relative_url(LOCAL_SHIM, page.url))


def on_post_template(output_content: str, template_name: str, **_: Any) -> str:
    """Do the same for the page of errors, which is no page of the folder."""
    return output_content.replace(SHIM, f"/{LOCAL_SHIM}")


def _plain_links(text: str) -> str:
    """Drop relative links, which lead to files of the repository that the manual does not have."""
    return re.sub(r"\[([^\]]+)\]\((?!https?:|#)[^)]+\)", r"\1", text)

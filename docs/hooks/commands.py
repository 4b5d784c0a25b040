"""The page of every command, from the command line's own help."""

from __future__ import annotations

import re

from ssil_data.cli import app, open_command

HEAD = """# Commands

Every command takes `--help`. `--store FOLDER`, or `SSIL_STORE` in the environment, says where the
datasets are: a folder, or a prefix of an object store such as `s3://bucket/prefix` with the
credentials in the usual environment variables. `--json` prints for machines.

Exit status: 0 fine; 1 a check found something; 2 the caller's mistake, with one message on standard
error and nothing written; 130 stopped by the keyboard.

`ssil-data --install-completion` installs completion of commands and options for bash, zsh or fish;
`ssil-data --version` prints the version.
"""


def render() -> str:
    """Return the page, Markdown: one section per command in the order of the list."""
    names = [name for name in app if not name.startswith("-")]
    for name in names:
        open_command(name)
    text = app.generate_docs(output_format="markdown", heading_level=1)
    sections = text[text.index("\n## ssil-data ") :]
    # the defaults of an option that may be left out are noise
    sections = re.sub(r" \*\[default: (\(\)|False|None|\"\")\]\*", "", sections)
    sections = sections.replace("```console\nssil-data", "```text\nssil-data")
    return HEAD + sections

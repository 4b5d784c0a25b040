"""The manual's tables of how good leverage is are those of the results that are kept."""

from __future__ import annotations

import importlib.util
import json

from support.demonstrations import ROOT

RESULTS = ROOT / "benchmarks" / "leverage.jsonl"
PAGE = ROOT / "docs" / "leverage-measured.md"
TABLES = ROOT / "benchmarks" / "parts" / "leverage_tables.py"


def test_the_tables_are_printed_from_the_results():
    spec = importlib.util.spec_from_file_location("leverage_tables", TABLES)
    assert spec is not None and spec.loader is not None
    tables = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tables)
    lines = [json.loads(line) for line in RESULTS.read_text().splitlines()]
    assert len({line["cell"] for line in lines}) == len(lines) > 500
    page = PAGE.read_text()
    start = "<!-- tables: benchmarks/leverage.jsonl -->\n\n"
    shown = page[page.index(start) + len(start) : page.index("\n<!-- end of tables -->")]
    assert shown == tables.format_tables(lines)

"""What a reproduction leaves: tables and ledger as CSV, settings and versions, the page."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from ssil_data.store.folder import Folder
from ssil_trainers.experiments import identity
from ssil_trainers.experiments.claims import claims, controls
from ssil_trainers.experiments.ledger import Verdict
from ssil_trainers.experiments.page import page
from ssil_trainers.experiments.plan import Plan
from ssil_trainers.experiments.protocol import TRAINING_TABLES
from ssil_trainers.experiments.results import Record, Results, curve


def publish(plan: Plan, results: Results) -> dict[str, int]:
    """Write everything into the plan's output folder; return how many claims got each verdict.

    A table that this run does not have, but one before it left there, is removed.
    """
    numbers = results.numbers(plan.tables)
    paper, own = results.judge(claims(), numbers), results.judge(controls(), numbers)
    counted = Counter(row["verdict"] for row in paper)
    verdicts = {verdict.value: counted[verdict.value] for verdict in Verdict}
    settings = _settings(plan)
    files = {f"{table.name}.csv": _csv(results.rows(table)) for table in plan.tables}
    files["leverage.csv"] = _csv([_flat(row) for row in results.leverage_rows()])
    files["ledger.csv"] = _csv([*paper, *own])
    files["curves.csv"] = _csv(_curves(results))
    files["settings.json"] = json.dumps(settings, indent=1) + "\n"
    processor = settings["processor"]
    made_by = {
        **{f"{name}, version": version for name, version in settings["versions"].items()},
        **{f"dataset {name}, version": version for name, version in settings["datasets"].items()},
        "code, digest": settings["code"],
        "commit, when the page was made": settings["commit"] or "not of a checkout",
        "processor": f"{processor['name']}: {' '.join(processor['features'])}",
    }
    files["index.html"] = page(
        plan, results, claims=paper, controls=own, verdicts=verdicts, made_by=made_by
    )
    for name in (f"{table.name}.csv" for table in TRAINING_TABLES):
        files.setdefault(name, "")
    for name, text in files.items():
        if text:
            Folder(plan.output).write(name, text.encode())
        else:
            (plan.output / name).unlink(missing_ok=True)
    return verdicts


def _settings(plan: Plan) -> dict[str, Any]:
    tables = {
        table.name: {
            "trained_on": table.train_on,
            "tests": list(table.tests),
            "episodes": table.episodes,
            "training": asdict(plan.settings(table, plan.seeds[0])),
        }
        for table in plan.tables
    }
    names = {table.dataset for table in plan.tables} | ({plan.leverage} - {None})
    return {
        "preset": plan.preset,
        "seeds": list(plan.seeds),
        "tables": tables,
        "datasets": {name: plan.source[name].version for name in sorted(filter(None, names))},
        "versions": identity.versions(),
        "code": identity.code(),
        "commit": identity.commit(),
        "processor": identity.processor(),
    }


def _curves(results: Results) -> list[Record]:
    return [
        {**record["identity"]["cell"], "steps": steps, "score": score}
        for record in results.records
        if "curve" in record
        for steps, score in zip(curve(record).steps, curve(record).scores, strict=True)
    ]


def _flat(row: Record) -> Record:
    """Return a row of leverage with a column for every tier."""
    tiers = dict(row["tiers"])
    flat = {name: row[name] for name in ("preset", "estimator", "seeds", "auroc", "spearman")}
    off = {f"{tier} deviation": d for tier, d in zip(tiers, row["deviations"], strict=True)}
    theirs = row["paper"] or [None] * len(tiers)
    published = {f"{tier} paper": value for tier, value in zip(tiers, theirs, strict=True)}
    return {**flat, **tiers, **off, **published}


def _csv(rows: Sequence[Record]) -> str:
    if not rows:
        return ""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()

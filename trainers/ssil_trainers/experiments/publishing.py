"""The files of a reproduction: tables and verdicts as CSV, settings and versions, the page."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from ssil_data.store.folder import Folder
from ssil_trainers.experiments import provenance
from ssil_trainers.experiments.claims import claims, controls
from ssil_trainers.experiments.page import render_page
from ssil_trainers.experiments.plan import Plan
from ssil_trainers.experiments.results import Record, Results, learning_curve
from ssil_trainers.experiments.tables import COVERAGE, TRAINING_TABLES
from ssil_trainers.experiments.verdicts import Verdict


def publish(plan: Plan, results: Results) -> dict[str, int]:
    """Write all files into the plan's output folder.

    Tables of an earlier run that this one does not have are removed.

    Parameters
    ----------
    plan:
        What was run.
    results:
        Its results.

    Returns
    -------
    :
        How many claims got each verdict.
    """
    numbers = results.numbers(plan.tables)
    paper = results.judge(claims(), numbers)
    own = results.judge(controls(), numbers)
    counts = Counter(row["verdict"] for row in paper)
    verdicts = {verdict.value: counts[verdict.value] for verdict in Verdict}
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
    files["index.html"] = render_page(
        plan, results, claims=paper, controls=own, verdicts=verdicts, made_by=made_by
    )
    for name in (f"{table.name}.csv" for table in (*TRAINING_TABLES, COVERAGE)):
        files.setdefault(name, "")
    for name, text in files.items():
        if text:
            Folder(plan.output).write(name, text.encode())
        else:
            (plan.output / name).unlink(missing_ok=True)
    return verdicts


def _settings(plan: Plan) -> dict[str, Any]:
    """Return everything that decided the results, as JSON."""
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
        "versions": provenance.package_versions(),
        "code": provenance.code_digest(),
        "commit": provenance.git_commit(),
        "processor": provenance.describe_processor(),
    }


def _curves(results: Results) -> list[Record]:
    """Return the points of all learning curves."""
    points = []
    for record in results.records:
        if "curve" in record:
            curve = learning_curve(record)
            for steps, score in zip(curve.steps, curve.scores, strict=True):
                points.append({**record["identity"]["cell"], "steps": steps, "score": score})
    return points


def _flat(row: Record) -> Record:
    """Return a row of leverage with a column for each tier."""
    tiers = dict(row["tiers"])
    flat = {name: row[name] for name in ("preset", "estimator", "seeds", "auroc", "spearman")}
    deviations = {f"{tier} deviation": d for tier, d in zip(tiers, row["deviations"], strict=True)}
    paper = row["paper"] or [None] * len(tiers)
    published = {f"{tier} paper": value for tier, value in zip(tiers, paper, strict=True)}
    return {**flat, **tiers, **deviations, **published}


def _csv(rows: Sequence[Record]) -> str:
    """Write rows as CSV with a header; nothing without rows."""
    if not rows:
        return ""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()

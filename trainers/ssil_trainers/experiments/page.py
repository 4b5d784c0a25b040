"""The page: results beside the paper's numbers, in one file that loads nothing from elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from ssil_data.report.rendering import MINUS, render
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.collection.racetrack import RacetrackSettings
from ssil_trainers.experiments import charts, published
from ssil_trainers.experiments.plan import Plan
from ssil_trainers.experiments.results import Record, Results
from ssil_trainers.experiments.tables import Table
from ssil_trainers.experiments.verdicts import TIE, verdicts_by_chance

HERE = Path(__file__).parent
FULL = 0.9995
"""The lowest score that is shown as 1.000."""
_CONTROLS = ("shuffled", "constant", "clone")


def render_page(
    plan: Plan,
    results: Results,
    *,
    claims: list[Record],
    controls: list[Record],
    verdicts: Mapping[str, int],
    made_by: Mapping[str, str],
) -> str:
    """Render the whole page as HTML.

    Parameters
    ----------
    plan:
        What was run.
    results:
        Its results.
    claims:
        The paper's claims with their verdicts.
    controls:
        The controls with theirs.
    verdicts:
        How many claims got each verdict.
    made_by:
        Versions and machine, by their names on the page.
    """
    seconds = sum(record["processor_seconds"] for record in results.records)
    context = {
        "cells": len(results.records),
        "seeds": plan.seeds,
        "preset": plan.preset,
        "hours": f"{seconds / 60:,.0f} min on one core",
        "verdicts": verdicts,
        "chance": verdicts_by_chance(len(plan.seeds)),
        "tie": TIE,
        "tables": plan.tables,
        "sections": _sections(plan, results),
        "claims": claims,
        "controls": controls,
        "settings": _settings(plan),
        "made_by": made_by,
    }
    return render(context, folder=HERE, filters={"number": _number, "count": _count})


def _sections(plan: Plan, results: Results) -> list[dict[str, Any]]:
    """Return the content of each table's section, in the order of their titles."""
    found = [_table(plan, table, results) for table in plan.tables]
    leverage = results.leverage_rows()
    if leverage:
        title = "Table II: leverage by quality of the demonstrations"
        found.append({"name": "leverage", "title": title, "leverage": leverage})
    return sorted(found, key=lambda section: section["title"])


def _table(plan: Plan, table: Table, results: Results) -> dict[str, Any]:
    """Return the content of one table's section."""
    rows = results.rows(table)
    over = {found["key"]: found for found in results.over_labels(table)}
    columns = [{"title": row.title, "control": row.method in _CONTROLS} for row in table.rows]
    return {
        "name": table.name,
        "title": table.title,
        "caption": _caption(table, results),
        "columns": columns,
        "blocks": [_block(table, rows, labels) for labels in table.labels],
        "over": [over.get(row.key) for row in table.rows] if len(table.labels) > 1 else [],
        "rows": rows,
        "finals": charts.finals(table, results),
        "curves": charts.curves(table, results),
        "evaluations": plan.training.evaluations,
        "train_on": table.train_on,
    }


def _caption(table: Table, results: Results) -> str:
    """Say how the scores of a table came about."""
    where = f"{'each of ' if len(table.tests) > 1 else ''}{', '.join(table.tests)}"
    found = [
        "All policies start from a behavior-cloned one." if table.pretrained else "",
        f"Score: mean return of {table.episodes} episodes on {where}, over",
        _unit(table, results),
        describe_saturation(table, results),
        published.REMARKS.get(table.name, ""),
    ]
    return " ".join(filter(None, found))


def _unit(table: Table, results: Results) -> str:
    """Say which return counts as 1, and why a score can exceed it."""
    if table.full_score is not None:
        return f"{table.full_score:g}."
    whole = results.full_score(table)
    number = "" if whole is None else f", {whole:,.0f},"
    return (
        f"the expert's mean return{number} without the normal noise of deviation "
        f"{RacetrackSettings().action_noise:g} on its actions, as a policy is tested."
        f"{_compare_with_recorded(whole, results.recorded_return(table))}"
    )


def _compare_with_recorded(whole: float | None, recorded: float | None) -> str:
    """Say how scores were counted before: by the return with noise, as recorded."""
    if whole is None or recorded is None or whole == recorded:
        return ""
    return (
        f" With the noise, as recorded, it is {recorded:,.0f}: scores by that, as published "
        f"before, are {whole / recorded:.3f} times as high."
    )


def describe_saturation(table: Table, results: Results) -> str:
    """Say which methods reach the full score, where a bounded score no longer separates them.

    Parameters
    ----------
    table:
        The table.
    results:
        Its results.

    Returns
    -------
    :
        A sentence; an empty text if no method reaches the full score.
    """
    means = {row["title"]: row["mean"] for row in results.rows(table)}
    full = [title for title, mean in means.items() if mean >= FULL]
    if table.full_score is None or not full:
        return ""
    after = f"After {results.budget(table):,} steps"
    if len(full) == len(means):
        return f"{after} every method and every control scores 1.000: the score separates none."
    less = ", ".join(f"{title} {mean:.3f}" for title, mean in means.items() if mean < FULL)
    return f"{after} these score 1.000 and are not separated: {', '.join(full)}; less: {less}."


def _block(table: Table, rows: list[Record], labels: int | None) -> dict[str, Any]:
    """Return the lines of one number of labels: ours, ours where trained, and the paper's."""
    by = {row["method"]: row for row in rows if row["labels"] == labels}
    found = [by.get(row.key) for row in table.rows]
    best = max(
        (f["mean"] for row, f in zip(table.rows, found, strict=True) if f and _ours(row.method)),
        default=None,
    )
    here = [
        f and {"mean": f["mean"], "deviation": f["deviation"], "best": f["mean"] == best}
        for f in found
    ]
    lines = [{"name": "here", "paper": False, "cells": here}]
    if table.tests != (table.train_on,):
        trained = [f and {"mean": f["where_trained"], "deviation": None, "best": 0} for f in found]
        lines.append({"name": "here, where trained", "paper": False, "cells": trained})
        most = [
            f and {"mean": f["most_where_trained"], "deviation": f["most_deviation"], "best": 0}
            for f in found
        ]
        lines.append({"name": "here, most where trained", "paper": False, "cells": most})
    paper = [published.SCORES.get((table.name, labels, row.key)) for row in table.rows]
    highest = max((p[0] for p in paper if p), default=None)
    cells = [p and {"mean": p[0], "deviation": p[1], "best": p[0] == highest} for p in paper]
    if highest is not None:
        lines.append({"name": "paper", "paper": True, "cells": cells})
    return {
        "labels": "all" if labels is None else f"{labels:,}",
        "laps": next((row["laps"] for row in by.values()), None),
        "lines": lines,
    }


def _ours(method: str) -> bool:
    """Return whether a method is compared, and no control."""
    return method not in _CONTROLS


def _settings(plan: Plan) -> dict[str, list[str]]:
    """Return every training setting by name, with its value for each table."""
    each = [asdict(plan.settings(table, plan.seeds[0])) for table in plan.tables]
    names = [field.name for field in fields(TrainSettings) if field.name != "seed"]
    return {name: [str(settings[name]) for settings in each] for name in names}


def _number(value: float | None) -> str:
    """Write a number with three decimals."""
    return "–" if value is None else f"{value:.3f}".replace("-", MINUS)


def _count(value: float | None) -> str:
    """Write a whole number."""
    return "–" if value is None else f"{value:,.0f}"

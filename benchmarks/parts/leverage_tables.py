"""The tables of `leverage.py`, as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

Line = dict[str, Any]
"""A line of the results."""
Value = Callable[[Line], float | None]
"""What a table has of a line."""


def format_tables(lines: list[Line]) -> str:
    """Return every table for which there are results, as the manual has them.

    Parameters
    ----------
    lines
        The results.
    """
    seeds = sorted({line["seed"] for line in lines})
    parts = [f"Seeds {seeds[0]} to {seeds[-1]}; mean (worst) over as many seeds as `n` says."]
    for title, table in (
        ("Racetrack: rank, weight and share by the default recipe", racetrack_ranks(lines)),
        ("Racetrack: cloning without driving, score of the expert's", racetrack_clones(lines)),
        ("Racetrack: GAIL after 16,384 steps, begun from the clone", racetrack_gail(lines)),
        ("RC car", rc_ranks(lines)),
        ("RC car: cloning, 401 labels", rc_clones(lines)),
        ("Sets made by others", others(lines)),
        ("What each piece is worth", ablation(lines)),
    ):
        if table:
            parts.append(f"### {title}\n\n" + "\n".join(table))
    return "\n\n".join(parts) + "\n"


def racetrack_ranks(lines: list[Line]) -> list[str]:
    """Give a row per labels and share: how good the leverage is.

    Parameters
    ----------
    lines
        The results.
    """
    chosen = [line for line in lines if line["kind"] == "racetrack" and line["recipe"] == "default"]
    return _quality_rows(chosen)


def rc_ranks(lines: list[Line]) -> list[str]:
    """Give the same rows for the RC car.

    Parameters
    ----------
    lines
        The results.
    """
    chosen = [line for line in lines if line["kind"] == "rc-lidar" and line["recipe"] == "default"]
    return _quality_rows(chosen)


def racetrack_clones(lines: list[Line]) -> list[str]:
    """Give a row per labels and share: scores of clones.

    Parameters
    ----------
    lines
        The results.
    """
    columns = [
        ("labeled alone", None, "clone"),
        ("all alike", None, "clone-mixed"),
        ("shuffled", "default", "clone-shuffled"),
        ("before", "before", "clone-leverage"),
        ("default", "default", "clone-leverage"),
        ("truth", "truth", "clone-leverage"),
    ]
    return _method_rows(lines, columns)


def racetrack_gail(lines: list[Line]) -> list[str]:
    """Give a row per labels and share: scores of GAIL, and how often leverage wins.

    Parameters
    ----------
    lines
        The results.
    """
    columns = [
        ("labeled", None, "gail"),
        ("all alike", None, "gail-mixed"),
        ("shuffled", "default", "gail-shuffled"),
        ("before", "before", "gail-leverage"),
        ("default", "default", "gail-leverage"),
        ("truth", "truth", "gail-leverage"),
    ]
    table = _method_rows(lines, columns)
    wins = _count_wins(lines)
    return [*table, *(["", *wins] if wins else [])]


def rc_clones(lines: list[Line]) -> list[str]:
    """Give a row per weights of the clone: score where it trained and on unseen tracks.

    Parameters
    ----------
    lines
        The results.
    """
    rows = []
    for title, recipe, method in (
        ("labeled alone", None, "clone"),
        ("all alike", None, "clone-mixed"),
        ("default", "default", "clone-leverage"),
        ("default, posterior", "default", "clone-posterior"),
        ("default, ratio", "default", "clone-ratio"),
        ("truth", "truth", "clone-leverage"),
    ):
        found = [
            line[method]
            for line in lines
            if line["kind"] == "rc-lidar" and line["recipe"] == recipe and method in line
        ]
        if found:
            first = [scores["hall"] for scores in found]
            unseen = [
                float(np.mean([score for track, score in scores.items() if track != "hall"]))
                for scores in found
            ]
            rows.append([title, _cell(first), _cell(unseen), str(len(found))])
    return _table(["weights", "training track", "four unseen tracks", "n"], rows)


def others(lines: list[Line]) -> list[str]:
    """Give a row per set and recipe.

    Parameters
    ----------
    lines
        The results.
    """
    rows = []
    for title, test in _OTHERS.items():
        found = [line for line in lines if test(line) and line["recipe"] == "default"]
        if found:
            rows.append(
                [
                    title,
                    _cell([line["auroc"] for line in found], 3),
                    _cell([line["spearman"] for line in found], 3),
                    _cell([line["weight_on_experts"] for line in found]),
                    str(len(found)),
                ]
            )
    return _table(["set", "AUROC", "Spearman", "weight on experts", "n"], rows)


def ablation(lines: list[Line]) -> list[str]:
    """Give a row per recipe: quality on every set, over the seeds that all recipes have.

    Parameters
    ----------
    lines
        The results.
    """
    recipes = list(dict.fromkeys(line["recipe"] for line in lines if line["recipe"]))
    recipes = [recipe for recipe in recipes if recipe != "truth"]
    seeds = {line["seed"] for line in lines if line["recipe"] == "no floor"}
    if not seeds:
        return []
    sets: dict[str, tuple[Callable[[Line], bool], Value]] = {
        **{
            f"racetrack {share:g}": (_racetrack_50(share), lambda line: line["auroc"])
            for share in (0.5, 0.09, 0.024)
        },
        "RC .5": (_rc_half, lambda line: line["auroc"]),
        **{
            title: (test, lambda line: line["auroc"])
            for title, test in _OTHERS.items()
            if not title.startswith("Pendulum")
        },
        "Pendulum, Spearman": (_OTHERS["Pendulum"], lambda line: line["spearman"]),
        **{
            f"weight {share:g}": (_racetrack_50(share), lambda line: line["weight_on_experts"])
            for share in (0.5, 0.09, 0.024)
        },
        **{
            f"clone {share:g}": (_racetrack_50(share), lambda line: line.get("clone-leverage"))
            for share in (0.5, 0.09, 0.024)
        },
    }
    rows = []
    for recipe in recipes:
        row = [recipe]
        for test, value in sets.values():
            found = [
                value(line)
                for line in lines
                if line["recipe"] == recipe and line["seed"] in seeds and test(line)
            ]
            row.append(_mean(found))
        rows.append(row)
    return _table(["recipe", *sets], rows)


def _racetrack_50(share: float) -> Callable[[Line], bool]:
    return lambda line: (
        line["kind"] == "racetrack" and line["labels"] == 50 and line["mixture_share"] == share
    )


def _rc_half(line: Line) -> bool:
    return line["kind"] == "rc-lidar" and line["labels"] == 401 and line["mixture_share"] == 0.5


_OTHERS: dict[str, Callable[[Line], bool]] = {
    "HalfCheetah (RIL-Co), 100 labels": lambda line: line.get("task") == "HalfCheetah",
    "Ant (RIL-Co), 100 labels": lambda line: line.get("task") == "Ant",
    "HalfCheetah (2IWIL), 600 labels": lambda line: line["kind"] == "cheetah",
    "Pendulum": lambda line: line["kind"] == "pendulum",
}


def _quality_rows(chosen: list[Line]) -> list[str]:
    rows = []
    for labels in sorted({line["labels"] for line in chosen}):
        for share in sorted({line["mixture_share"] for line in chosen}, reverse=True):
            found = [
                line
                for line in chosen
                if line["labels"] == labels and line["mixture_share"] == share
            ]
            if not found:
                continue
            ratio = [line["estimated_share"] / line["share"] for line in found]
            honest = [
                line["interval"][0] - 1e-3 <= line["share"] <= line["interval"][1] + 1e-3
                for line in found
            ]
            within = sum(1 / 1.5 <= each <= 1.5 for each in ratio)
            rows.append(
                [
                    str(labels),
                    f"{share:g}",
                    _cell([line["auroc"] for line in found], 3),
                    _cell([line["weight_on_experts"] for line in found]),
                    _cell([line["calibration_error"] for line in found], 3, worst=max),
                    f"{within}/{len(found)}",
                    f"{sum(honest)}/{len(found)}",
                    f"{np.median([line['seconds'] for line in found]):.1f}",
                ]
            )
    header = [
        "labels",
        "share",
        "AUROC",
        "weight on experts",
        "calibration error",
        "share within 1.5×",
        "interval holds",
        "processor s",
    ]
    return _table(header, rows)


def _method_rows(lines: list[Line], columns: list[tuple[str, str | None, str]]) -> list[str]:
    lines = [line for line in lines if line["kind"] == "racetrack"]
    rows = []
    for labels in sorted({line["labels"] for line in lines}):
        for share in sorted({line["mixture_share"] for line in lines}, reverse=True):
            cells = [
                [
                    line[method]
                    for line in lines
                    if line["labels"] == labels
                    and line["mixture_share"] == share
                    and line["recipe"] == recipe
                    and method in line
                ]
                for _, recipe, method in columns
            ]
            if any(cells):
                most = max(map(len, cells))
                rows.append([str(labels), f"{share:g}", *map(_cell, cells), str(most)])
    return _table(["labels", "share", *(title for title, _, _ in columns), "n"], rows)


def _count_wins(lines: list[Line]) -> list[str]:
    """Say in how many seeds GAIL by leverage is above each control, at 50 labels."""
    found = []
    for share in (0.5, 0.09, 0.024):
        for title, recipe, method in (
            ("labeled", None, "gail"),
            ("all alike", None, "gail-mixed"),
            ("shuffled", "default", "gail-shuffled"),
        ):
            ours = _by_seed(lines, share, "default", "gail-leverage")
            theirs = _by_seed(lines, share, recipe, method)
            both = sorted(ours.keys() & theirs.keys())
            wins = sum(ours[seed] > theirs[seed] for seed in both)
            if both:
                found.append(f"- share {share:g}: above {title} in {wins} of {len(both)} seeds.")
    return found


def _by_seed(lines: list[Line], share: float, recipe: str | None, method: str) -> dict[int, float]:
    test = _racetrack_50(share)
    return {
        line["seed"]: line[method]
        for line in lines
        if test(line) and line["recipe"] == recipe and method in line
    }


def _cell(values: Iterable[float | None], digits: int = 2, *, worst: Callable = min) -> str:
    known = [value for value in values if value is not None]
    if not known:
        return "–"
    return f"{np.mean(known):.{digits}f} ({worst(known):.{digits}f})"


def _mean(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{np.mean(known):.3f}" if known else "–"


def _table(header: list[str], rows: list[list[str]]) -> list[str]:
    if not rows:
        return []
    lines = [header, ["---"] * len(header), *rows]
    return ["| " + " | ".join(line) + " |" for line in lines]

"""How far each run can be trusted: what it says of itself, and what the tiers say, if known."""

from __future__ import annotations

from typing import Any

from ssil_data.quality import compare_with_tiers
from ssil_data.report.bins import Rows
from ssil_data.report.evidence import Evidence, ScoredRun
from ssil_data.report.style import Spec
from ssil_data.report.trust_chart import draw_trust
from ssil_data.store.run_record import UNCHECKED


def describe_trust(evidence: Evidence) -> dict[str, Any]:
    """Return the table and the chart of the section about trust.

    Parameters
    ----------
    evidence
        The runs.

    Returns
    -------
    dict
        `health` has a row for each run, `trust` the chart, None where there is nothing to draw,
        `tiered` and `shares` say what the chart has, `weak` has the runs that are, `unchecked`
        is what stands for a held-out AUROC that is not known.
    """
    return {
        "tiered": evidence.chosen.quality.true_expert_share is not None,
        "shares": any(run.run.expert_share is not None for run in evidence.runs),
        "health": [_describe_run(run) for run in evidence.runs],
        "unchecked": UNCHECKED,
        "trust": _draw(evidence),
        "weak": [run for run in evidence.runs if run.run.weak],
    }


def _describe_run(scored: ScoredRun) -> dict[str, Any]:
    """Return what a run says of itself, beside the truth."""
    run = scored.run
    quality = scored.quality
    share = run.expert_share
    return {
        "run": scored,
        "pooling": run.pooling["kind"],
        "labels": run.labeled,
        "episodes": run.labeled_episodes,
        "laps": run.laps,
        "share": share,
        "interval": run.expert_share_interval,
        "true_share": quality.true_expert_share,
        "effective": run.effective_pairs,
        "weight": run.weight_on_experts,
        "true_weight": quality.true_weight_on_experts,
        "error": run.calibration_error,
        "true_error": quality.true_calibration_error,
        "auroc": run.held_out_auroc,
        # experts among the unlabeled pairs cannot be told from experts that were held out
        "perfect": None if share is None else 1 - share / 2,
    }


def _draw(evidence: Evidence) -> Spec | None:
    """Draw calibration where tiers are known, and expert shares where runs estimate them."""
    curves = _list_curves(evidence)
    shares = _list_shares(evidence)
    if not curves and not shares:
        return None
    return draw_trust(curves, shares, evidence.names, evidence.chosen.key)


def _list_curves(evidence: Evidence) -> Rows:
    """Return a point for each bin of each run."""
    rows: Rows = []
    for run in evidence.runs:
        curve = compare_with_tiers(evidence.dataset, run.leverage)
        if curve is None:
            continue
        rows += [
            {
                "key": run.key,
                "leverage": round(float(leverage), 4),
                "truth": round(float(truth), 4),
                "pairs": int(pairs),
            }
            for leverage, truth, pairs in zip(
                curve.leverage, curve.expert_share, curve.pairs, strict=True
            )
        ]
    return rows


def _list_shares(evidence: Evidence) -> Rows:
    """Return the estimated share of each run that has one, with its interval and the truth."""
    rows: Rows = []
    for scored in evidence.runs:
        run = scored.run
        if run.expert_share is None or run.expert_share_interval is None:
            continue
        truth = scored.quality.true_expert_share
        rows.append(
            {
                "run": run.name,
                "share": round(run.expert_share, 4),
                "low": round(run.expert_share_interval[0], 4),
                "high": round(run.expert_share_interval[1], 4),
                "truth": None if truth is None else round(truth, 4),
            }
        )
    return rows

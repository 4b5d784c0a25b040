"""What a run says of itself, as fields for machines and as sentences for people."""

from __future__ import annotations

from typing import Any

from ssil_data.store.run_record import Run


def list_health(run: Run) -> dict[str, Any]:
    """Return how a run was made and how good it can be, as `--json` prints it.

    Parameters
    ----------
    run:
        Its record.
    """
    json = run.to_json()
    names = (
        "labeled_episodes",
        "laps",
        "expert_share",
        "expert_share_interval",
        "effective_pairs",
        "weight_on_experts",
        "calibration_error",
        "held_out_auroc",
        "weak",
    )
    return {
        "pooling": run.pooling["kind"],
        "scale": run.scale["kind"],
        "labeled": run.labeled,
        **{name: json[name] for name in names},
    }


def describe_health(run: Run) -> list[str]:
    """Return the same in sentences: only what is known, reasons to distrust the run last.

    Parameters
    ----------
    run:
        Its record.
    """
    return [_describe_labels(run), *_describe_weights(run), *_describe_held_out(run), *warn(run)]


def warn(run: Run) -> list[str]:
    """Return the reasons not to trust a run, one line each.

    Parameters
    ----------
    run:
        Its record.
    """
    return [f"Weak: {run.name}: {reason}" for reason in run.weak]


def _describe_labels(run: Run) -> str:
    parts = [f"Rests on {run.labeled:,} labeled pairs"]
    if run.labeled_episodes is not None:
        plural = "" if run.labeled_episodes == 1 else "s"
        parts.append(f"of {run.labeled_episodes:,} episode{plural}")
    if run.laps is not None:
        parts.append(f"({run.laps:.2g} laps)")
    if run.self_trained:
        parts.append(f"and {run.self_trained:,} of the purest unlabeled ones")
    return " ".join(parts)


def _describe_weights(run: Run) -> list[str]:
    lines = []
    if run.expert_share is not None and run.expert_share_interval is not None:
        low, high = run.expert_share_interval
        is_stated = run.scale.get("expert_share") is not None
        known = "as stated" if is_stated else f"90 % interval {low:.3f} to {high:.3f}"
        lines.append(f"Expert share of the unlabeled pairs: {run.expert_share:.3f} ({known})")
    if run.effective_pairs is not None:
        line = f"Effective pairs: {run.effective_pairs:,.0f} of the unlabeled ones"
        if run.weight_on_experts is not None:
            line += f"; of their weight, {run.weight_on_experts:.3f} is expected on experts"
        lines.append(line)
    return lines


def _describe_held_out(run: Run) -> list[str]:
    lines = []
    if run.held_out_auroc is None and not run.cross_fit:
        lines.append("Unchecked: no labeled pairs were held out; the preset default holds them out")
    if run.held_out_auroc is not None:
        line = f"Held-out experts against the unlabeled pairs: AUROC {run.held_out_auroc:.3f}"
        if run.expert_share is not None:
            # the unlabeled pairs contain experts, which cannot be told from experts
            line += f" (with that share, about {1 - run.expert_share / 2:.3f} is perfect)"
        lines.append(line)
    if run.calibration_error is not None:
        lines.append(f"Calibration error by held-out experts: {run.calibration_error:.3f}")
    return lines

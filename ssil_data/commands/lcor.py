"""The command `ssil-data lcor`: the leverage of demonstrations near given states."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from ssil_data.commands.output import (
    AsJson,
    StoreLocation,
    StoreOption,
    console,
    print_json,
    print_table,
)
from ssil_data.errors import InvalidInputError
from ssil_data.field import LCoR, LCoRQuery
from ssil_data.interop import read_states
from ssil_data.kernels import check_alpha
from ssil_data.store.dataset import Dataset


def lcor(
    name: str,
    /,
    *,
    run: str,
    states: Path | None = None,
    episode: int | None = None,
    alpha: str | None = None,
    query: Annotated[LCoRQuery, Parameter(name="*")] = LCoRQuery(),  # noqa: B008
    location: StoreOption = StoreLocation(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Compute LCoR of states: the mean leverage of the demonstrations near each, 0 to 1.

    The effective sample size is the number of demonstration states that a value rests on.
    Close to the data few decide; nearly all of them mean that the state is far from every
    demonstration, and the value only the mean leverage of the dataset.

    Parameters
    ----------
    name:
        The dataset.
    run:
        The run whose leverage is averaged.
    states:
        File of states in raw units: .npy, .npz, .csv or .parquet, one column per dimension.
    episode:
        Use the states of this episode of the dataset instead of a file.
    alpha:
        Sharpness of the kernel: large values count only the nearest states. "auto" is the run's
        own, at which a value rests on about a tenth of the states.
    query:
        How exact the values must be, and whether contributors are listed. Without any of these,
        all states count.
    """
    dataset = location.open()[name]
    field = dataset.field(run, alpha=_parse_alpha(alpha))
    if (states is None) == (episode is None):
        found = "neither" if states is None else "both"
        raise InvalidInputError(f"lcor: give --states or --episode, one of them; found {found}")
    if episode is not None:
        queries = dataset.episode(episode).states
    else:
        assert states is not None
        queries = read_states(states, dataset.state_names)
    answer = field.lcor(queries, **asdict(query))
    top = _list_contributors(dataset, answer) if query.contributors else None
    if json:
        result: dict[str, Any] = {
            "alpha": field.alpha,
            "lcor": answer.values.tolist(),
            "effective_sample_size": answer.effective_sample_size.tolist(),
            "half_width": answer.half_width.tolist(),
        }
        print_json(result if top is None else {**result, "contributors": top})
    else:
        title = f"LCoR over {len(field.states):,} demonstration states, alpha {field.alpha:.4g}"
        _print_answer(answer, top, unit="state" if episode is None else "step", title=title)
        if not query.exact:
            sampled = int((answer.half_width > 0).sum())
            console().print(
                f"{sampled:,} of {len(answer.values):,} values from a random part of the states; "
                "the others from all states, which took less work."
            )


def _parse_alpha(text: str | None) -> float | None:
    """Return a number, or None for the run's own alpha."""
    if text is None or text == "auto":
        return None
    try:
        number = float(text)
    except ValueError:
        raise InvalidInputError(f'alpha: expected a number > 0 or "auto", found {text}') from None
    return check_alpha(number)


def _list_contributors(dataset: Dataset, answer: LCoR) -> list[list[dict[str, Any]]]:
    """Return episode, step and share of the pairs that contributed most to each value."""
    index = np.concatenate([np.column_stack(batch.columns) for batch in dataset.index()])
    return [
        [
            {"episode": int(index[row, 0]), "step": int(index[row, 1]), "share": float(share)}
            for row, share in zip(rows, shares, strict=True)
        ]
        for rows, shares in zip(answer.contributors.row, answer.contributors.share, strict=True)
    ]


def _print_answer(
    answer: LCoR,
    top: list[list[dict[str, Any]]] | None,
    *,
    unit: str,
    title: str,
) -> None:
    """Print at most 25 values, evenly spread, and a line that sums up all of them."""
    shown = np.unique(np.linspace(0, len(answer.values) - 1, 25).astype(int))
    rows = []
    for index in map(int, shown):
        row: dict[str, Any] = {
            unit: index,
            "LCoR": float(answer.values[index]),
            "effective sample size": int(answer.effective_sample_size[index]),
        }
        if answer.half_width.any():
            row["±"] = f"{answer.half_width[index]:.1e}"
        if top is not None:
            row["contributors"] = ", ".join(
                f"{one['episode']}:{one['step']} {one['share']:.1%}" for one in top[index][:5]
            )
        rows.append(row)
    print_table(title, rows)
    values = answer.values
    if len(shown) < len(values):
        console().print(f"{len(shown)} of {len(values):,} {unit}s shown; --json prints all.")
    console().print(
        f"{len(values):,} {unit}s: LCoR mean {values.mean():.3f}, "
        f"lowest {values.min():.3f} at {unit} {values.argmin()}, highest {values.max():.3f}"
    )

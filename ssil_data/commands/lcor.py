"""The command `ssil-data lcor`: how good is the neighbourhood of states?"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from ssil_data.commands.output import (
    AsJson,
    Place,
    StorePlace,
    console,
    print_json,
    print_table,
)
from ssil_data.errors import InvalidInputError
from ssil_data.field.answers import Accuracy, LCoR
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
    contributors: int = 0,
    accuracy: Annotated[Accuracy, Parameter(name="*")] = Accuracy(),  # noqa: B008
    place: StorePlace = Place(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Ask how good the neighbourhood of states is: LCoR and how many states it rests on.

    Parameters
    ----------
    name:
        The dataset.
    run:
        The run whose leverage is asked.
    states:
        File of states in raw units: .npy, .npz, .csv or .parquet, one column per dimension.
    episode:
        Ask along this episode of the dataset instead of a file.
    alpha:
        Sharpness of the kernel, or "auto": the run's own, which rests on a tenth of the store.
    contributors:
        Also give the pairs that contributed most, this many per state.
    accuracy:
        Without it, all pairs are asked.
    """
    dataset = place.open()[name]
    sharpness = _alpha(alpha)
    field = dataset.field(run, alpha=sharpness)
    if (states is None) == (episode is None):
        found = "neither" if states is None else "both"
        raise InvalidInputError(f"lcor: expected --states or --episode, found {found}")
    if episode is not None:
        asked = dataset.episode(episode).states
    else:
        assert states is not None
        asked = read_states(states, dataset.state_names)
    answer = field.lcor(asked, contributors=contributors, **asdict(accuracy))
    top = _contributors(dataset, answer) if contributors else None
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
        if not accuracy.exact:
            sampled = int((answer.half_width > 0).sum())
            console().print(
                f"{sampled:,} of {len(answer.values):,} answers from a random part of the states; "
                "the others from all of them, which was the shorter way."
            )


def _alpha(text: str | None) -> float | None:
    if text is None or text == "auto":
        return None
    try:
        number = float(text)
    except ValueError:
        raise InvalidInputError(f'alpha: expected a number > 0 or "auto", found {text}') from None
    return check_alpha(number)


def _contributors(dataset: Dataset, answer: LCoR) -> list[list[dict[str, Any]]]:
    place = np.concatenate([np.column_stack(batch.columns) for batch in dataset.index()])
    return [
        [
            {"episode": int(place[row, 0]), "step": int(place[row, 1]), "share": float(share)}
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
        f"least {values.min():.3f} at {unit} {values.argmin()}, most {values.max():.3f}"
    )

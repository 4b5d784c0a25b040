"""Commands about datasets: datasets, import, validate, card, delete."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from ssil_data.commands.output import AsJson, StoreLocation, StoreOption, print_json, print_table
from ssil_data.errors import DamagedError, InvalidInputError
from ssil_data.interop import Columns, ImportedEpisodes, Layout, import_episodes, read_columns
from ssil_data.store.dataset import Dataset
from ssil_data.store.episodes import check_dimension_names
from ssil_data.store.summary import summarize

_Columns = Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative=())]


def datasets(*, location: StoreOption = StoreLocation(), json: AsJson = False) -> None:  # noqa: B008
    """List the datasets of the store."""
    rows = [summarize_dataset(dataset) for dataset in location.open()]
    if json:
        print_json({"datasets": rows})
    elif rows:
        print_table(f"Datasets in {location.store}", rows)
    else:
        print(f"No datasets in {location.store}")


def import_file(
    file: Path,
    /,
    *,
    name: str,
    state: _Columns = (),
    action: _Columns = (),
    episode: str | None = None,
    labeled: _Columns = (),
    step: str | None = None,
    reward: str | None = None,
    position: _Columns = (),
    score: str | None = None,
    tier: str | None = None,
    append: Annotated[bool, Parameter(negative=())] = False,
    location: StoreOption = StoreLocation(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Import demonstrations from an npz, CSV or Parquet file as a new dataset.

    Columns called states, actions, episode, reward, position, score, tier and labeled are found
    without being named. The whole file is checked before anything is written.

    Parameters
    ----------
    file:
        The file: .npz, .csv or .parquet.
    name:
        The dataset's name in the store.
    state:
        Columns, or arrays, that make the state, in this order.
    action:
        Columns, or arrays, that make the action, in this order.
    episode:
        Column with one value per episode, whose rows are adjacent. Without it, the file is one
        episode.
    labeled:
        Which episodes an expert drove: values of the episode column (3 7 or 0-9), "all", or the
        name of a column of true and false.
    step:
        Column that must rise by one within an episode.
    reward:
        Column of true rewards, for evaluation only.
    position:
        Two columns, x and y in meters, for maps only.
    score:
        Column of an episode's true quality, for evaluation only; without it, the sum of rewards.
    tier:
        Column of an episode's quality tier, "expert" for the best one, for evaluation only.
    append:
        Add the episodes to an existing dataset, as its next version.
    """
    columns = read_columns(file)
    layout = Layout(
        state=state,
        action=action,
        episode=episode,
        step=step,
        reward=reward,
        position=position,
        score=score,
        tier=tier,
        labeled=labeled,
    )
    found = import_episodes(columns, layout)
    store = location.open()
    if append:
        with store.open_for_writing(name) as before:
            dataset = _refuse_other_names(before, found).append(found.episodes)
    else:
        dataset = store.create(
            name,
            found.episodes,
            state_names=found.state_names,
            action_names=found.action_names,
            card=_card(name, columns, found),
        )
    row = summarize_dataset(dataset)
    if json:
        print_json(row)
        return
    print_table(f"Imported {file}", [row])
    if not row["labeled"]:
        print("No episode is labeled: `ssil-data score` needs at least one (--labeled).")


def validate(
    name: str,
    /,
    *,
    repair: Annotated[bool, Parameter(negative=())] = False,
    location: StoreOption = StoreLocation(),  # noqa: B008
    json: AsJson = False,
) -> int:
    """Read every file of a dataset and report what has changed since it was written.

    Exit status 1 if anything is damaged.

    Parameters
    ----------
    name:
        The dataset.
    repair:
        First restore what can be: one flipped bit of a log entry, the card or a run's settings, and
        the digests kept beside them.
    """
    store = location.open()
    restored = store.repair(name) if repair else []
    version = None
    try:
        dataset = store[name]
        version = dataset.version
        damaged = dataset.find_damage()
    except DamagedError as error:
        damaged = [str(error)]
    if json:
        row = {"dataset": name, "version": version, "damaged": damaged}
        print_json(row | {"restored": restored} if repair else row)
        return 1 if damaged else 0
    for sentence in restored:
        print(sentence)
    if damaged:
        print("\n".join(damaged))
    else:
        print(f"{name} {version}: every file is as it was written")
    return 1 if damaged else 0


def card(name: str, /, *, location: StoreOption = StoreLocation()) -> None:  # noqa: B008
    """Print the card of a dataset, Markdown: where its demonstrations come from.

    Parameters
    ----------
    name:
        The dataset.
    """
    print(location.open()[name].card.rstrip())


def delete(
    name: str,
    /,
    *,
    yes: Annotated[bool, Parameter(negative=())] = False,
    location: StoreOption = StoreLocation(),  # noqa: B008
) -> int:
    """Delete a dataset with its runs. This cannot be undone.

    Exit status 1 if the question was not answered with the dataset's name.

    Parameters
    ----------
    name:
        The dataset.
    yes:
        Do not ask. Needed where standard input is not a terminal.
    """
    store = location.open()
    row = summarize_dataset(store[name])
    if not yes and not _confirm_delete(row):
        print(f"{name} was not deleted")
        return 1
    store.delete(name)
    print(f"Deleted {name}")
    return 0


def _confirm_delete(row: dict[str, str | int]) -> bool:
    """Ask on the terminal for the dataset's name; refuse where there is no terminal to ask on."""
    if not sys.stdin.isatty():
        raise InvalidInputError(
            f"delete {row['dataset']}: cannot ask for confirmation without a terminal; add --yes"
        )
    print(f"Pairs: {row['pairs']:,}. Runs: {row['runs']}.")
    try:
        return input("Type its name to delete it: ").strip() == row["dataset"]
    except EOFError:
        return False


def summarize_dataset(dataset: Dataset) -> dict[str, Any]:
    """Return a dataset's summary as a row, with numbers of dimensions and runs, not their names."""
    row: dict[str, Any] = dict(summarize(dataset))
    names = {"state": row.pop("state_names"), "action": row.pop("action_names")}
    runs = row.pop("runs")
    return {**row, "state": len(names["state"]), "action": len(names["action"]), "runs": len(runs)}


def _refuse_other_names(dataset: Dataset, found: ImportedEpisodes) -> Dataset:
    """Return the dataset if the new episodes have its state and action names, in its order."""
    check_dimension_names(
        dataset.name,
        found={"state": found.state_names, "action": found.action_names},
        expected={"state": dataset.state_names, "action": dataset.action_names},
    )
    return dataset


def _card(name: str, columns: Columns, found: ImportedEpisodes) -> str:
    labeled = [episode for episode in found.episodes if episode.labeled]
    return (
        f"# {name}\n\nImported from `{columns.path.name}`: {len(found.episodes)} episodes, "
        f"{sum(map(len, found.episodes))} pairs; {len(labeled)} episodes, "
        f"{sum(map(len, labeled))} pairs labeled.\n\n"
        f"State: {', '.join(found.state_names)}.\n\nAction: {', '.join(found.action_names)}.\n"
    )

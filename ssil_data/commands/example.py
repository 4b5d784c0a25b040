"""The command `ssil-data example`: a small real dataset to try the other commands on."""

from __future__ import annotations

from ssil_data.commands.data import summarize_dataset
from ssil_data.commands.output import (
    AsJson,
    StoreLocation,
    StoreOption,
    print_json,
    print_table,
)
from ssil_data.example import read_example


def example(
    *,
    name: str = "racetrack-example",
    location: StoreOption = StoreLocation(),  # noqa: B008
    json: AsJson = False,
) -> None:
    """Write a small sample of the simulated racetrack demonstrations as a new dataset.

    14,350 pairs in 51 episodes, 6 of them labeled, with true quality and positions, so that score,
    show and report have something to show at once.

    Parameters
    ----------
    name:
        The dataset's name in the store.
    """
    sample = read_example()
    dataset = location.open().create(
        name,
        sample.episodes,
        state_names=sample.state_names,
        action_names=sample.action_names,
        card=sample.card,
    )
    row = summarize_dataset(dataset)
    if json:
        print_json(row)
        return
    print_table(f"Wrote the example to {location.store}", [row])
    option = "" if location.store == StoreLocation().store else f" --store {location.store}"
    print(f"Next: ssil-data score {name}{option}")
    print(f"      ssil-data show {name}{option}")
    print(f"      ssil-data report {name} -o report.html{option}")

"""The runs of a dataset are listed as of one moment."""

from typing import Any

import pytest

from ssil_data.estimators import VAE
from ssil_data.scoring import score
from ssil_data.store.dataset import Dataset
from ssil_data.store.delta_table import VersionedTable


@pytest.mark.parametrize("what", ["all", "find_damage"])
def test_a_run_that_is_committed_while_runs_are_listed_is_no_damage(
    what: str, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
):
    score(dataset, VAE(steps=2), run="first")
    later = iter(["second"])
    opened = VersionedTable.__init__

    def opening(self: VersionedTable, *given: Any, **more: Any) -> None:
        opened(self, *given, **more)
        if self.folder.uri.endswith("leverage") and (name := next(later, None)):
            score(dataset, VAE(steps=2), run=name)

    monkeypatch.setattr(VersionedTable, "__init__", opening)
    found = getattr(dataset.runs, what)()
    assert [getattr(run, "name", run) for run in found] == (["first"] if what == "all" else [])

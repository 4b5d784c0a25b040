"""Where a training run's demonstrations come from when the service is missing or broken."""

from __future__ import annotations

import pytest

from ssil_data.commands import serving
from ssil_data.commands.output import StoreLocation
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset


@pytest.mark.parametrize("missing", ["ssil_service", "fastapi", "uvicorn"])
def test_without_the_service_the_store_is_read(
    store: Store, dataset: Dataset, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    monkeypatch.setattr(serving, "import_module", lambda name: raise_missing(missing))
    with serving.open_store(StoreLocation(store.folder.uri), None) as opened:
        assert isinstance(opened, Store)


@pytest.mark.parametrize("missing", ["ssil_service.server.embedded", "pyarrow"])
def test_a_service_that_is_broken_is_not_taken_for_none(
    store: Store, dataset: Dataset, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    monkeypatch.setattr(serving, "import_module", lambda name: raise_missing(missing))
    with (
        pytest.raises(ModuleNotFoundError, match=missing),
        serving.open_store(StoreLocation(store.folder.uri), None),
    ):
        pass


def raise_missing(name: str) -> None:
    raise ModuleNotFoundError(f"No module named {name!r}", name=name)

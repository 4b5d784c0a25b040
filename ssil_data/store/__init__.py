"""The demonstration store: datasets and runs in versioned Delta Lake tables of plain Parquet."""

from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run
from ssil_data.store.runs import Runs
from ssil_data.store.store import Store

__all__ = ["Dataset", "Run", "Runs", "Store"]

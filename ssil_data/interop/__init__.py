"""Foreign files as demonstrations; each format is one module that reads named columns."""

from ssil_data.interop.columns import Columns, Layout
from ssil_data.interop.episodes import Imported, import_episodes
from ssil_data.interop.files import SUFFIXES, read_columns, read_states

__all__ = [
    "SUFFIXES",
    "Columns",
    "Imported",
    "Layout",
    "import_episodes",
    "read_columns",
    "read_states",
]

"""Other people's files as demonstrations: a module for each format reads named columns."""

from ssil_data.interop.columns import Columns
from ssil_data.interop.episodes import ImportedEpisodes, import_episodes
from ssil_data.interop.files import SUFFIXES, read_columns, read_states
from ssil_data.interop.layout import Layout

__all__ = [
    "SUFFIXES",
    "Columns",
    "ImportedEpisodes",
    "Layout",
    "import_episodes",
    "read_columns",
    "read_states",
]

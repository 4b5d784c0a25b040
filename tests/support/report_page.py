"""A report as a browser sees it, and datasets to report on."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

from ssil_data.demonstrations import Episode
from ssil_data.report import write_report
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive


class Page(HTMLParser):
    """What a browser sees: tags, attributes, and the visible text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.text = ""
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_data(self, data: str) -> None:
        if self.tags[-1:] != ["script"]:
            self.text += data

    @property
    def sections(self) -> list[str]:
        return [value for name, value in self.attributes if name == "id" and value != "run"]


def read_report(dataset: Dataset, folder: Path) -> Page:
    write_report(dataset, folder / "report.html")
    return Page(folder / "report.html")


def silent(what: str, done: int, of: int) -> None:
    """Show no progress."""


def create_plain(
    store: Store, episodes: list[Episode], names: tuple[str, ...] = STATE_NAMES
) -> Dataset:
    return store.create("plain", episodes, state_names=names, action_names=ACTION_NAMES)


def with_positions(seed: int, **known: object) -> Episode:
    return drive(seed, 40, positions=drive(seed, 40).states[:, :2], **known)

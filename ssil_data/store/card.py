"""The card of a dataset: Markdown, written last and once, whose digest is kept beside it."""

from __future__ import annotations

import hashlib

from ssil_data.errors import DamagedError, NotFoundError
from ssil_data.store.acknowledged import read_digests, write_digests
from ssil_data.store.folder import Folder

CARD = "card.md"


def write_card(folder: Folder, text: str) -> None:
    """Write the card of a new dataset, which appears with it.

    Parameters
    ----------
    folder
        The dataset's.
    text
        Markdown.
    """
    data = text.encode()
    write_digests(folder, {CARD: hashlib.sha256(data).hexdigest()})
    folder.write(CARD, data)


def read_card(folder: Folder) -> str:
    """Read the card of a dataset.

    Parameters
    ----------
    folder
        The dataset's.

    Raises
    ------
    DamagedError
        If it is not as it was written; one of version 0.1.0 has no digest to tell.
    """
    data = folder.read(CARD)
    expected = (read_digests(folder) or {}).get(CARD)
    if expected not in (None, hashlib.sha256(data).hexdigest()):
        raise DamagedError(f"{folder.uri}/{CARD}: it is not as it was written")
    return data.decode()


def find_card_damage(folder: Folder) -> list[str]:
    """Say whether the card is not as it was written, or gone.

    Parameters
    ----------
    folder
        The dataset's.
    """
    try:
        read_card(folder)
    except (DamagedError, NotFoundError, UnicodeDecodeError) as error:
        return [str(error)]
    return []

"""Files in one folder on disk or under one prefix of an object store, written durably."""

from __future__ import annotations

import os
import re
import secrets
import stat
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

import pyarrow as pa
from pyarrow import fs

from ssil_data.errors import DamagedError, InvalidInputError, NotFoundError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


def check_name(kind: str, name: str) -> str:
    """Return a name if it can be a folder of the store and nothing above it.

    Parameters
    ----------
    kind
        What the message calls the thing, such as `dataset`.
    name
        The name.

    Raises
    ------
    InvalidInputError
        For a name that is too long, empty, or has other characters.
    """
    if not _NAME.fullmatch(name):
        raise InvalidInputError(
            f"{kind} name: expected up to 100 letters, digits, '.', '_' or '-', "
            f"beginning with a letter or digit, found {name!r}"
        )
    return name


def sync(path: Path) -> None:
    """Put a local file's bytes, or a folder's names, on the disk before returning.

    Parameters
    ----------
    path
        The file or folder.
    """
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


class Folder:
    """A folder by path, or a prefix by URI (`s3://…`), with credentials in the environment."""

    def __init__(self, location: str | Path, *, root: Path | None = None) -> None:
        """Point at a location; nothing is created before the first write.

        Parameters
        ----------
        location
            A path or URI.
        root
            The local folder that nothing is read outside of; this one unless given.

        Raises
        ------
        InvalidInputError
            For a URI that no file system knows, or a path with `%`.
        """
        self.local: Path | None = None
        self.root: Path | None = None
        place = urlsplit(str(location))
        if "://" not in str(location) or place.scheme == "file":
            path = url2pathname(place.path) if place.scheme == "file" else location
            if "%" in str(path):
                raise InvalidInputError(
                    f"store: expected a path without '%', which Delta Lake decodes, found {path}"
                )
            self.local = Path(path).absolute()
            self.root = self.local if root is None else root
            self.uri = str(self.local)
            self._path = self.uri
            self._files = fs.LocalFileSystem()
            return
        self.uri = str(location).rstrip("/")
        try:
            self._files, self._path = fs.FileSystem.from_uri(self.uri)
        except (pa.ArrowException, OSError) as error:
            raise InvalidInputError(
                f"store: expected a folder or s3://bucket/prefix, found {location} ({error})"
            ) from None

    @property
    def delta_uri(self) -> str:
        """The location in the form in which Delta Lake takes any character."""
        return self.uri if self.local is None else self.local.as_uri()

    def __truediv__(self, name: str) -> Folder:
        """Return a folder below this one.

        Parameters
        ----------
        name
            Its name.
        """
        return Folder(f"{self.uri}/{name}", root=self.root)

    def __repr__(self) -> str:
        """Show the location."""
        return f"Folder({self.uri!r})"

    def names(self) -> list[str]:
        """List what lies directly in the folder, sorted; nothing if it does not exist."""
        selector = fs.FileSelector(self._path, allow_not_found=True)
        return sorted(info.base_name for info in self._files.get_file_info(selector))

    def exists(self, name: str = "") -> bool:
        """Tell whether the folder, or a file or folder in it, exists.

        Parameters
        ----------
        name
            Of a file or folder in it; the folder itself unless given.
        """
        (info,) = self._files.get_file_info([f"{self._path}/{name}".rstrip("/")])
        return info.type != fs.FileType.NotFound

    def open(self, name: str) -> pa.NativeFile:
        """Open a file for random reads.

        Parameters
        ----------
        name
            The file, below the folder.

        Raises
        ------
        NotFoundError
            If there is none.
        DamagedError
            If it is no regular file, or leads out of the store.
        """
        self.check_file(name)
        try:
            return self._files.open_input_file(f"{self._path}/{name}")
        except FileNotFoundError:
            raise NotFoundError(f"file: there is none at {self.uri}/{name}") from None

    def check_file(self, name: str) -> None:
        """Refuse a local file that is no regular one or leads out of the store.

        Parameters
        ----------
        name
            Of a file below the folder; nothing is checked if it does not exist.

        Raises
        ------
        DamagedError
            With the name of the file.
        """
        if self.local is not None:
            self._check_inside(self.local / name)

    def check_files(self, name: str) -> None:
        """Refuse a local folder in which anything is no regular file or leads out of the store.

        For libraries that read such a folder by themselves.

        Parameters
        ----------
        name
            Of a folder in this one; nothing is checked if it does not exist.

        Raises
        ------
        DamagedError
            With the name of the file.
        """
        if self.local is None:
            return
        with suppress(FileNotFoundError), os.scandir(self.local / name) as entries:
            for entry in entries:
                if entry.is_symlink() or not entry.is_file():
                    self._check_inside(Path(entry.path))
            self._check_inside(self.local / name, folder=True)

    def _check_inside(self, path: Path, *, folder: bool = False) -> None:
        """Raise DamagedError for what waits for a writer, as a pipe does, or lies elsewhere."""
        try:
            mode = path.stat().st_mode
        except (FileNotFoundError, NotADirectoryError):
            return  # what is not there is told by who opens it
        except OSError as error:
            raise DamagedError(f"{path}: it cannot be read ({error.strerror})") from None
        if not (stat.S_ISDIR(mode) if folder else stat.S_ISREG(mode)):
            raise DamagedError(f"{path}: it is no {'folder' if folder else 'regular file'}")
        if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(self.root or "/")):
            raise DamagedError(f"{path}: it leads out of {self.root}, and is not read")

    def read(self, name: str) -> bytes:
        """Read a whole file.

        Parameters
        ----------
        name
            The file, below the folder.

        Raises
        ------
        NotFoundError
            If there is none.
        """
        with self.open(name) as file:
            return file.read()

    def write(self, name: str, data: bytes | pa.Buffer) -> None:
        """Write a whole file so that it is there completely or not at all, even after a power cut.

        On disk: a temporary file, synced, renamed, and the folder synced. An object store's put
        is atomic and durable by itself.

        Parameters
        ----------
        name
            The file, directly in the folder.
        data
            Its bytes.
        """
        if self.local is None:
            with self._files.open_output_stream(f"{self._path}/{name}") as file:
                file.write(data)
            return
        self.make()
        temporary = self.local / f".{name}.{secrets.token_hex(4)}"
        try:
            with temporary.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(self.local / name)
        finally:
            temporary.unlink(missing_ok=True)
        sync(self.local)

    def make(self) -> None:
        """Create a local folder and those above it durably; an object store needs none."""
        if self.local is None or self.local.is_dir():
            return
        Folder(self.local.parent).make()
        self.local.mkdir(exist_ok=True)
        sync(self.local.parent)

    def rename(self, target: Folder) -> bool:
        """Move a local folder to an unused name.

        Parameters
        ----------
        target
            Where it is to be, on the same disk.

        Returns
        -------
        bool
            False if the name was taken meanwhile.
        """
        assert self.local is not None and target.local is not None
        try:
            self.local.rename(target.local)
        except OSError:
            return False
        sync(target.local.parent)
        return True

    def delete(self) -> None:
        """Delete the folder and all in it."""
        if self.exists():
            self._files.delete_dir(self._path)

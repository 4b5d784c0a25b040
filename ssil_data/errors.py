"""What can go wrong, by whose fault; every message names the thing, the expected and the found."""


class SsilDataError(Exception):
    """The caller's mistake; the command exits with 2 and nothing is written."""


class InvalidInputError(SsilDataError, ValueError):
    """A value, file or option does not have the form that was asked for."""


class NotFoundError(SsilDataError, LookupError):
    """A dataset, run, column or file of that name does not exist."""


class ConflictError(SsilDataError):
    """The name is taken, or the thing belongs to another version of the dataset."""


class DamagedError(SsilDataError):
    """Stored bytes are not the bytes that were written."""

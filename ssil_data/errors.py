"""What can go wrong, and whose fault it is.

A message names the thing first. Where there are two values it names both, expected and found;
otherwise it says what happened and what to do.
"""


class SsilDataError(Exception):
    """The caller's mistake; the command exits with 2 and nothing is written.

    Examples
    --------
    >>> try:
    ...     store["laps"]
    ... except sd.SsilDataError as error:
    ...     print(type(error).__name__)
    NotFoundError
    """


class InvalidInputError(SsilDataError, ValueError):
    """A value, file or option does not have the expected form.

    Examples
    --------
    >>> sd.Quantile(low=0.9, high=0.1)
    Traceback (most recent call last):
    ...
    ssil_data.errors.InvalidInputError: quantile: expected 0 <= low < high <= 1, found ...
    """


class NotFoundError(SsilDataError, LookupError):
    """A dataset, run, column or file of that name does not exist.

    Examples
    --------
    >>> dataset.runs["gpr"]
    Traceback (most recent call last):
    ...
    ssil_data.errors.NotFoundError: run of drives: expected one of [vae], found 'gpr'
    """


class ConflictError(SsilDataError):
    """The name is taken, or the thing belongs to another version of the dataset.

    Examples
    --------
    >>> sd.score(dataset, sd.VAE(steps=20), run="vae")
    Traceback (most recent call last):
    ...
    ssil_data.errors.ConflictError: run of drives: the name 'vae' is taken; give another
    """


class DamagedError(SsilDataError):
    """Stored bytes are not the bytes that were written.

    Examples
    --------
    >>> from ssil_data.estimators import load
    >>> try:
    ...     load(b"not an archive")
    ... except sd.DamagedError as error:
    ...     print("damaged")
    damaged
    """

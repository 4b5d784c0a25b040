"""The `ssil-data` command: which subcommands there are; each is imported when it is called."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import NoReturn

from cyclopts import App, CycloptsError

from ssil_data.errors import InvalidInputError, SsilDataError

app = App(
    name="ssil-data",
    help="Which of my demonstrations can I trust? Leverage and LCoR for imitation learning.",
    version=version("ssil-data"),
)
app.register_install_completion_command(
    help="Install completion of commands and options for your shell (bash, zsh, fish)."
)

_COMMANDS = {
    "ssil_data.commands": {
        "example": ("example:example", "Write a small sample dataset to try the commands on."),
        "datasets": ("data:datasets", "List the datasets of the store."),
        "card": ("data:card", "Print the card of a dataset: where it comes from."),
        "import": ("data:import_file", "Import demonstrations from an npz, CSV or Parquet file."),
        "validate": ("data:validate", "Check that no file of a dataset has changed."),
        "delete": ("data:delete", "Delete a dataset with its runs."),
        "score": ("leverage:score", "Give every pair of a dataset a leverage in [0, 1]."),
        "show": ("show:show", "Compare runs: what each says of itself, and how it ranks quality."),
        "lcor": ("lcor:lcor", "Compute LCoR: the mean leverage of the demonstrations near states."),
        "report": ("leverage:report", "Write one offline HTML page about a dataset's runs."),
    },
    "ssil_service": {
        "serve": ("server.command:serve", "Serve leverage and LCoR over REST."),
    },
    "ssil_trainers": {
        "collect": ("commands.collect:collect", "Drive a simulator and store the demonstrations."),
        "train": ("commands.train:train", "Train a policy: GAIL, MixGAIL, SSIL, cloning."),
        "evaluate": ("commands.evaluate:evaluate", "Drive the real environment by a policy file."),
        "reproduce": (
            "experiments.reproduce:reproduce",
            "Run the paper's tables again and compare them with its claims.",
        ),
    },
}
"""Package → command → its function and one line of help. A function is imported when it is called,
so that `--help` is quick and a command of a package that is not installed can say so."""

for _package, _commands in _COMMANDS.items():
    for _name, (_function, _help) in _commands.items():
        app.command(f"{_package}.{_function}", name=_name, help=_help)


def main(words: Sequence[str] | None = None) -> NoReturn:
    """Run the command line.

    Parameters
    ----------
    words:
        The arguments, without the program's name. None takes those of this process.

    Raises
    ------
    SystemExit
        Always, with the exit status: 0 fine, 1 a check found something, 2 the caller's mistake,
        130 stopped by the keyboard.
    """
    words = sys.argv[1:] if words is None else list(words)
    try:
        _check_command(words)
        if words and not words[0].startswith("-"):
            open_command(words[0])
        status = app(words, exit_on_error=False, result_action="return_value")
    except CycloptsError:
        raise SystemExit(2) from None
    except SsilDataError as error:
        raise _refusal(str(error)) from None
    except ImportError as error:
        missing = error.__cause__ or error
        if not isinstance(missing, ModuleNotFoundError):
            raise
        raise _refusal(
            f"{words[0]}: the package {missing.name!r} is not installed; "
            "pip install 'ssil-data[all]'"
        ) from None
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 1
    except OSError as error:
        raise _refusal(str(error)) from None
    except KeyboardInterrupt:
        print("ssil-data: stopped; nothing unfinished is kept", file=sys.stderr)
        raise SystemExit(130) from None
    raise SystemExit(status or 0)


def _check_command(words: Sequence[str]) -> None:
    """Refuse an unknown command here: the parser would import every command to explain it."""
    commands = [name for name in app if not name.startswith("-")]
    if words and not words[0].startswith("-") and words[0] not in commands:
        raise InvalidInputError(f"command: expected one of {commands}, found {words[0]!r}")


def open_command(name: str) -> App:
    """Return a command, imported, whose help is the whole text of its function.

    Parameters
    ----------
    name:
        A command of `app`. Until it is opened, it has the line of help of the list of commands.
    """
    command = app[name]
    if command.default_command is not None:
        command.help = None
    return command


def _refusal(message: str) -> SystemExit:
    """Print a message for the caller's mistake and return the end of the process to raise."""
    print(f"ssil-data: {message}", file=sys.stderr)
    return SystemExit(2)

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

_COMMANDS = {
    "datasets": ("data:datasets", "List the datasets of the store."),
    "import": ("data:import_file", "Import demonstrations from an npz, CSV or Parquet file."),
    "validate": ("data:validate", "Check that every file of a dataset is as it was written."),
    "score": ("leverage:score", "Give every pair of a dataset a leverage in [0, 1]."),
    "show": ("leverage:show", "Show leverage by quality tier, and how well it ranks quality."),
    "lcor": ("lcor:lcor", "Ask how good the neighbourhood of states is."),
    "report": ("leverage:report", "Write one offline HTML page about a dataset's runs."),
}

for _name, (_where, _help) in _COMMANDS.items():
    app.command(f"ssil_data.commands.{_where}", name=_name, help=_help)
app.command(
    "ssil_trainers.commands.collect:collect",
    name="collect",
    help="Drive, and write the demonstrations as a dataset.",
)
app.command(
    "ssil_service.server.command:serve",
    name="serve",
    help="Serve leverage and LCoR over REST.",
)
app.command(
    "ssil_trainers.commands.train:train", name="train", help="Train a policy: GAIL, MixGAIL, SSIL."
)
app.command(
    "ssil_trainers.commands.evaluate:evaluate",
    name="evaluate",
    help="Drive the real environment by a policy file.",
)
app.command(
    "ssil_trainers.experiments.reproduce:reproduce",
    name="reproduce",
    help="Run the paper's tables again, with controls, a ledger of its claims and one page.",
)


def main(words: Sequence[str] | None = None) -> NoReturn:
    """Run the command line, or the words of one.

    Exit status: 0 fine, 1 a check found something, 2 the caller's mistake.
    """
    words = sys.argv[1:] if words is None else list(words)
    try:
        _check_command(words)
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
            f"{words[0]}: expected the package {missing.name!r}, found none; "
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
    """Refuse an unknown command before the parser imports every command to explain it."""
    commands = [name for name in app if not name.startswith("-")]
    if words and not words[0].startswith("-") and words[0] not in commands:
        raise InvalidInputError(f"command: expected one of {commands}, found {words[0]!r}")


def _refusal(message: str) -> SystemExit:
    print(f"ssil-data: {message}", file=sys.stderr)
    return SystemExit(2)

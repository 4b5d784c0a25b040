"""The `ssil-data` command: which subcommands there are; each is imported when it is called."""

from __future__ import annotations

import sys
from importlib.metadata import version

from cyclopts import App, CycloptsError

from ssil_data.errors import SsilDataError

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
    "lcor": ("leverage:lcor", "Ask how good the neighbourhood of states is."),
    "report": ("leverage:report", "Write one offline HTML page about a dataset's runs."),
}

for _name, (_where, _help) in _COMMANDS.items():
    app.command(f"ssil_data.commands.{_where}", name=_name, help=_help)
app.command(
    "ssil_trainers.collect:collect",
    name="collect",
    help="Drive, and write the demonstrations as a dataset.",
)


def main() -> None:
    """Run the command line.

    Exit status: 0 fine, 1 a check found something, 2 the caller's mistake.
    """
    try:
        app(exit_on_error=False)
    except CycloptsError:
        raise SystemExit(2) from None
    except SsilDataError as error:
        print(f"ssil-data: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0].startswith("ssil"):
            raise
        print(
            f"ssil-data: expected the package {error.name!r}, found it missing; "
            "install ssil-data[all]",
            file=sys.stderr,
        )
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None

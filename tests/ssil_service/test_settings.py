"""Settings: flags, then the environment, and the command that takes them."""

import socket
import subprocess
import sys
from pathlib import Path

import pytest

from ssil_data.errors import InvalidInputError
from ssil_service.settings import read_settings

WRITE_KEY = "writes-and-deletes-too"


def test_settings_come_from_flags_then_the_environment(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SSIL_PORT", "81")
    monkeypatch.setenv("SSIL_HOST", "localhost")
    settings = read_settings(port=82)
    assert (settings.port, settings.host) == (82, "localhost")
    with pytest.raises(InvalidInputError, match="port"):
        read_settings(port=-1)
    monkeypatch.setenv("SSIL_WRITE_KEY", WRITE_KEY)
    assert WRITE_KEY not in repr(read_settings())


@pytest.mark.parametrize("flags", [["--host", "0.0.0.0"], ["--port", "-1"]])
def test_the_command_refuses_with_status_2(flags: list[str], tmp_path: Path):
    command = [sys.executable, "-c", "from ssil_data.cli import main; main()", "serve", *flags]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert flags[0].removeprefix("--").split("-")[0] in done.stderr


def test_a_port_or_a_folder_that_cannot_be_had_is_one_message(tmp_path: Path):
    (tmp_path / "file").touch()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        for flags in (["--port", port], ["--port", "0", "--state", str(tmp_path / "file" / "a")]):
            command = [sys.executable, "-c", "from ssil_data.cli import main; main()", "serve"]
            done = subprocess.run(
                [*command, *flags], capture_output=True, text=True, check=False, cwd=tmp_path
            )
            assert done.returncode == 2
            assert len(done.stderr.splitlines()) == 1
            assert flags[-1] in done.stderr

"""The container image, as far as it can be tested without a container engine.

What the Dockerfile copies is enough to build the package; the image's entry point, environment
and health check fit the service; it does not run as root and holds no key.
"""

import json
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from zipfile import ZipFile

import pytest
from pydantic import SecretStr

from ssil_data.errors import InvalidInputError
from ssil_service.http.route_kinds import HEALTH_CHECKS
from ssil_service.security.authentication import refuse_open_access
from ssil_service.settings import Settings
from support.demonstrations import ROOT

Instruction = tuple[str, str]


def read_stages() -> list[list[Instruction]]:
    """Return the instructions of the Dockerfile's stages, each as its name and its arguments."""
    text = (ROOT / "service" / "Dockerfile").read_text().replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    stages: list[list[Instruction]] = []
    for line in lines:
        name, _, arguments = line.partition(" ")
        if name == "FROM":
            stages.append([])
        stages[-1].append((name, arguments.strip()))
    return stages


def copied_files() -> list[str]:
    """Return what the build stage copies out of the repository."""
    copies = [arguments.split() for name, arguments in read_stages()[0] if name == "COPY"]
    return [source for words in copies for source in words[:-1]]


def image_environment() -> dict[str, str]:
    """Return the variables that the last stage sets."""
    assignments = [arguments for name, arguments in read_stages()[-1] if name == "ENV"]
    words = [word for each in assignments for word in shlex.split(each)]
    return dict(word.split("=", 1) for word in words)


def test_nothing_is_sent_to_the_builder_but_what_is_copied():
    ignored = (ROOT / ".dockerignore").read_text().splitlines()
    assert "*" in ignored
    assert {line[1:] for line in ignored if line.startswith("!")} == set(copied_files())


def test_all_that_the_build_reads_is_copied():
    configuration = tomllib.loads((ROOT / "pyproject.toml").read_text())
    project = configuration["project"]
    packages = configuration["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    runs = " ".join(arguments for name, arguments in read_stages()[0] if name == "RUN")
    constraints = re.findall(r"-c (\S+)", runs)
    files = ["pyproject.toml", project["readme"], *project["license-files"], *constraints]
    assert set(copied_files()) == {*files, *(Path(each).parts[0] for each in packages)}


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package as a wheel built of the copied files alone, unpacked."""
    folder = tmp_path_factory.mktemp("image")
    source = folder / "source"
    source.mkdir()
    for name in copied_files():
        ignore = shutil.ignore_patterns("__pycache__", "*.egg-info", ".service")
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, ignore=ignore)
        else:
            shutil.copy(ROOT / name, source / name)
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    target = folder / "site"
    with ZipFile(wheel) as archive:
        archive.extractall(target)
    return target


def test_the_entry_point_is_a_command_of_the_package_that_is_built(installed: Path):
    (entry,) = [arguments for name, arguments in read_stages()[-1] if name == "ENTRYPOINT"]
    command, *words = json.loads(entry)
    (scripts,) = installed.glob("*.dist-info/entry_points.txt")
    (function,) = re.findall(rf"^{command} = ([\w.]+:\w+)$", scripts.read_text(), re.MULTILINE)
    module, name = function.split(":")
    code = f"import sys; from {module} import {name}; {name}(); sys.exit()"
    shown = subprocess.run(
        [sys.executable, "-c", code, *words, "--help"],
        env={"PYTHONPATH": str(installed), "COLUMNS": "120"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert shown.returncode == 0, shown.stderr
    assert "Serve leverage and LCoR" in shown.stdout
    assert "--grace-seconds" in shown.stdout


def test_the_application_is_in_the_package_that_is_built(installed: Path):
    code = "import ssil_service.app as app; print(app.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert Path(done.stdout.strip()) == installed / "ssil_service" / "app.py"


def test_the_variables_of_the_image_are_settings_of_the_service():
    variables = image_environment()
    given = {
        name.removeprefix("SSIL_").lower(): value
        for name, value in variables.items()
        if name.startswith("SSIL_")
    }
    assert given and set(given) <= set(Settings.model_fields)
    settings = Settings(**given)  # pyright: ignore[reportArgumentType]
    volumes = [arguments for name, arguments in read_stages()[-1] if name == "VOLUME"]
    assert json.loads(volumes[0]) == [settings.store, str(settings.state)]
    with pytest.raises(InvalidInputError, match="SSIL_READ_KEY"):
        refuse_open_access(settings)
    refuse_open_access(settings.model_copy(update={"read_key": SecretStr("a-key-of-the-tests")}))


def test_the_health_check_asks_the_port_that_the_image_listens_on():
    port = image_environment()["SSIL_PORT"]
    instructions = read_stages()[-1]
    assert ("EXPOSE", port) in instructions
    (check,) = [arguments for name, arguments in instructions if name == "HEALTHCHECK"]
    (url_port, path) = re.findall(r"http://127\.0\.0\.1:(\d+)(/\w+)", check)[0]
    assert url_port == port
    assert path in HEALTH_CHECKS


def test_the_image_runs_as_a_user_without_rights():
    instructions = read_stages()[-1]
    names = [name for name, _ in instructions]
    (user,) = [arguments for name, arguments in instructions if name == "USER"]
    runs = " && ".join(arguments for name, arguments in instructions if name == "RUN")
    assert f"useradd --system --uid 10001 --no-create-home {user}" in runs
    last_run = len(names) - 1 - names[::-1].index("RUN")
    assert last_run < names.index("USER") < names.index("ENTRYPOINT")


def test_the_image_holds_no_key():
    for stage in read_stages():
        for name, arguments in stage:
            assert name not in ("ENV", "ARG") or "KEY" not in arguments

"""Every example in a docstring runs, and every public name has one."""

from __future__ import annotations

import ast
import doctest
import importlib
import inspect
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import ssil_data as sd
import ssil_data.client
from support.demonstrations import ACTION_NAMES, ROOT, STATE_NAMES, drives

PACKAGES = {
    "ssil_data": ROOT / "ssil_data",
    "ssil_service": ROOT / "service" / "ssil_service",
    "ssil_trainers": ROOT / "trainers" / "ssil_trainers",
}
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def docstrings() -> Iterator[tuple[str, str, str]]:
    """Yield module, qualified name and docstring of everything whose docstring has an example.

    The sources are read and not imported, so that collecting the tests stays quick.
    """
    for package, folder in PACKAGES.items():
        for file in sorted(folder.rglob("*.py")):
            parts = file.relative_to(folder).with_suffix("").parts
            module = ".".join([package, *parts]).removesuffix(".__init__")
            tree = ast.parse(file.read_text())
            for name, node in definitions(tree, ""):
                text = ast.get_docstring(node) or ""
                if ">>>" in text:
                    yield module, name, text


def definitions(
    node: ast.AST, prefix: str
) -> Iterator[tuple[str, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Yield a module, its classes and functions, and those inside them, with qualified names."""
    if isinstance(node, ast.Module):
        yield "", node
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield prefix + child.name, child
            yield from definitions(child, f"{prefix}{child.name}.")


EXAMPLES = list(docstrings())


@pytest.fixture(scope="module")
def scored_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with the dataset `drives` and its run `vae`."""
    folder = tmp_path_factory.mktemp("docstrings") / "store"
    dataset = sd.Store(folder).create(
        "drives", drives(), state_names=STATE_NAMES, action_names=ACTION_NAMES, card="# Drives"
    )
    sd.score(dataset, sd.VAE(steps=20), run="vae")
    return folder


@pytest.mark.parametrize(
    ("module", "name", "text"), EXAMPLES, ids=[f"{m}:{n}" for m, n, _ in EXAMPLES]
)
def test_an_example_prints_what_it_says(
    module: str,
    name: str,
    text: str,
    scored_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.chdir(tmp_path)
    store = sd.Store(shutil.copytree(scored_folder, tmp_path / "store"))
    names = vars(importlib.import_module(module)) | {
        "sd": sd,
        "np": np,
        "store": store,
        "dataset": store["drives"],
    }
    if "remote" not in text:
        run_example(text, names, f"{module}:{name}")
        return
    from ssil_service import embed

    with embed(tmp_path / "store", jobs=1) as remote:
        run_example(text, names | {"remote": remote}, f"{module}:{name}")


def run_example(text: str, names: dict[str, object], name: str) -> None:
    """Run a docstring's examples; fail with what they printed instead."""
    test = doctest.DocTestParser().get_doctest(text, dict(names), name, None, 0)
    found: list[str] = []
    result = doctest.DocTestRunner(optionflags=FLAGS).run(test, out=found.append)
    assert result.attempted, f"{name} has no example that runs"
    assert not result.failed, "".join(found)
    assert "doctest: +SKIP" not in text, f"{name} skips an example"


@pytest.mark.parametrize("name", sd.__all__)
def test_every_name_of_the_library_has_an_example(name: str):
    assert ">>>" in (getattr(sd, name).__doc__ or ""), f"sd.{name} has no example"


@pytest.mark.parametrize("name", ssil_data.client.__all__)
def test_every_name_of_the_client_has_an_example(name: str):
    assert ">>>" in (getattr(ssil_data.client, name).__doc__ or ""), f"{name} has no example"


@pytest.mark.parametrize("name", sd.__all__)
def test_every_parameter_of_a_public_function_is_explained(name: str):
    public = getattr(sd, name)
    if not inspect.isfunction(public):
        pytest.skip("not a function")
    for parameter in inspect.signature(public).parameters:
        assert f"{parameter}" in (public.__doc__ or "").partition("Parameters\n")[2], parameter

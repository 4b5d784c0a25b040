"""The README and the manual are true: their code runs, and they name all that there is to name."""

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

import ssil_data as sd
from ssil_data.cli import app
from ssil_data.estimators import ESTIMATORS
from ssil_data.example import read_example
from ssil_data.scales import SCALES
from ssil_data.scoring import PRESETS
from ssil_service import embed
from ssil_service.settings import Settings
from ssil_trainers.algorithms.methods import METHODS
from support.demonstrations import DATASETS, ROOT, drives
from support.markdown import EXECUTED, check_console, read_blocks, run_blocks
from support.preloaded import preload

MANUAL = ROOT / "docs"
README = ROOT / "README.md"
PAGES = sorted(
    [
        README,
        *(ROOT / name for name in ("CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md")),
        ROOT / "service" / "README.md",
        ROOT / "trainers" / "README.md",
        *MANUAL.rglob("*.md"),
    ]
)
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
WITH_CODE = [page for page in PAGES if any(b.language in EXECUTED for b in read_blocks(page))]
QUICK_START = next(block for block in read_blocks(README) if block.language in EXECUTED)
EXAMPLES = MANUAL / "reference" / "rest-examples.md"


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the pages suppose: datasets, the scored example, a log, queries."""
    folder = tmp_path_factory.mktemp("manual")
    shutil.copytree(DATASETS, folder / "datasets")
    example = read_example()
    dataset = sd.Store(folder / "datasets").create(
        "racetrack-example",
        example.episodes,
        state_names=example.state_names,
        action_names=example.action_names,
        card=example.card,
    )
    quick = sd.Ensemble((sd.VAE(steps=50), sd.Contrast(steps=50)))
    sd.score(dataset, replace(sd.preset("default"), estimator=quick, cross_fit=False))
    assert dataset.runs["ensemble"].name == sd.preset("default").estimator.kind
    rows = [
        {"speed": float(s[1]), "heading": float(s[2]), "steer": float(a[1]), "lap": lap}
        for lap, drive in enumerate(drives())
        for s, a in zip(drive.states, drive.actions, strict=True)
    ]
    lines = [",".join(rows[0]), *(",".join(map(str, row.values())) for row in rows)]
    (folder / "laps.csv").write_text("\n".join(lines) + "\n")
    pq.write_table(pa.Table.from_pylist(rows), folder / "laps.parquet")
    pairs = dataset.episode(10)
    np.save(folder / "states.npy", pairs.states[:4])
    states = pairs.states[:4].tolist()
    actions = pairs.actions[:4].tolist()
    tensor = {"name": "states", "shape": [4, 29], "datatype": "FP32", "data": states}
    bodies = {
        "states": {"states": states},
        "pairs": {"states": states, "actions": actions},
        "infer": {"inputs": [tensor]},
    }
    for name, body in bodies.items():
        (folder / f"{name}.json").write_text(json.dumps(body))
    return folder


@pytest.fixture(scope="module")
def binaries(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder whose commands do not import torch each time."""
    with preload(tmp_path_factory.mktemp("binaries")) as folder:
        yield folder


@pytest.fixture(scope="module")
def started(prepared: Path, binaries: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the commands were run that the README and the manual begin with."""
    folder = tmp_path_factory.mktemp("started") / "reader"
    shutil.copytree(prepared, folder)
    sd.Store(folder / "datasets").delete("racetrack-example")
    run_blocks([QUICK_START], folder, binaries)
    return folder


@pytest.mark.parametrize("page", WITH_CODE, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_block_of_code_runs_in_its_order(
    page: Path, request: pytest.FixtureRequest, binaries: Path, tmp_path: Path
):
    blocks = [block for block in read_blocks(page) if block.language in EXECUTED]
    begins_alike = blocks[0] == QUICK_START
    assert begins_alike or "ssil-data example\n" not in page.read_text()
    folder = tmp_path / "reader"
    shutil.copytree(request.getfixturevalue("started" if begins_alike else "prepared"), folder)
    printed = run_blocks(blocks[begins_alike:], folder, binaries)
    if page == EXAMPLES:
        assert '"state":"succeeded"' in printed
        assert "ssil_request_seconds" in printed
        assert pq.read_metadata(folder / "leverage.parquet").num_rows == 49_200
    for report in folder.glob("*.html"):
        assert report.stat().st_size > 100_000


def test_the_pages_with_code_are_most_of_the_manual():
    assert len(WITH_CODE) >= 14


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_commands_that_are_not_run_parse(page: Path):
    for block in read_blocks(page):
        if block.language == "console":
            check_console(block)


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_to_files_lead_somewhere(page: Path):
    generated = ("commands.md", "rest.md", "settings.md")
    for target in re.findall(r"\]\((?!https?:|#)([^)#]+)", page.read_text()):
        known = Path(target).name in generated and MANUAL in page.parents
        assert known or (page.parent / target).exists(), f"{page}: {target}"


def test_the_readme_is_short_and_spells_the_rewards_out():
    text = README.read_text()
    assert len(text.splitlines()) <= 150
    for words in ("leverage constraint reward", "constraint reward (CoR)", "2021", "simulated"):
        assert words in text, words


def test_every_command_is_in_the_readme_and_every_choice_in_the_manual():
    readme = README.read_text()
    for name in app:
        if not name.startswith("-"):
            assert f"`{name}`" in readme, name
    manual = "\n".join(page.read_text() for page in MANUAL.rglob("*.md"))
    for name in (*ESTIMATORS, *SCALES, *METHODS):
        assert f"`{name}`" in manual, name
    for name in PRESETS:
        assert f"`--preset {name}`" in manual, name


def test_every_make_target_is_named():
    text = README.read_text() + (ROOT / "CONTRIBUTING.md").read_text()
    targets = re.findall(r"^([a-z]+):.*##", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for target in set(targets) - {"format", "clean"}:
        assert f"make {target}" in text, target


def test_every_route_has_its_curl(tmp_path: Path):
    lines = "\n".join(b.code for b in read_blocks(EXAMPLES)).replace("\\\n", " ").splitlines()
    requests = set()
    for line in lines:
        for url in re.findall(r"http://127\.0\.0\.1:8765([^ ?\"|]*)", line):
            sends = "-d " in line or "--data-binary" in line
            method = "PUT" if "-T " in line else "POST" if sends else "GET"
            method = next(iter(re.findall(r"-X (\w+)", line)), method)
            requests.add((method, url))
    with embed(tmp_path) as store:
        document = store.connection.json("GET", "openapi.json")
    assert len(document["paths"]) > 20
    for path, operations in document["paths"].items():
        pattern = re.compile(re.sub(r"\{\w+\}", "[^/]+", path))
        for method in operations:
            found = any(m == method.upper() and pattern.fullmatch(url) for m, url in requests)
            assert found, f"{method.upper()} {path}"


def test_every_public_name_is_in_the_reference():
    text = (MANUAL / "reference" / "library.md").read_text()
    documented = set(re.findall(r"^::: ssil_data\.(?:\w+\.)?(\w+)$", text, re.MULTILINE))
    assert documented == set(sd.__all__)


def test_the_glossary_names_files_that_exist_and_names_that_stand_in_them():
    rows = re.findall(
        r"^\|.*\| ([^|]*) \| `([\w/]+\.py)` \|$",
        (MANUAL / "concepts" / "glossary.md").read_text(),
        re.MULTILINE,
    )
    assert len(rows) >= 20
    for names, path in rows:
        assert (ROOT / path).is_file(), path
        for name in re.findall(r"`([\w.]+)`", names):
            assert re.search(rf"\b{name.split('.')[-1]}\b", (ROOT / path).read_text()), (name, path)


def test_the_site_has_every_page_in_its_navigation():
    listed = set(re.findall(r": ([\w/-]+\.md)$|- ([\w/-]+\.md)$", _navigation(), re.MULTILINE))
    named = {one or other for one, other in listed}
    assert {str(page.relative_to(MANUAL)) for page in MANUAL.rglob("*.md")} <= named


def test_every_setting_of_the_service_is_in_the_generated_page(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(MANUAL / "hooks"))
    import settings  # pyright: ignore[reportMissingImports]

    page = settings.render()
    for name in Settings.model_fields:
        assert f"`SSIL_{name.upper()}`" in page, name


def test_workflows_and_citation_are_valid_and_call_what_exists():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())
    steps = [step for job in workflow["jobs"].values() for step in job["steps"]]
    assert any(step.get("run") == "bash .ci/run" for step in steps)
    for step in steps:
        assert re.fullmatch(r"[\w./-]+@v\d+", step.get("uses", "a@v1"))
    assert (ROOT / ".github" / "try-wheel").is_file()
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["license"] == "Apache-2.0"
    assert citation["preferred-citation"]["url"] in README.read_text()


def _navigation() -> str:
    return (ROOT / "mkdocs.yml").read_text().split("\nnav:\n")[1]

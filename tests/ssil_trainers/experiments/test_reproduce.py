"""Cells end to end on a small store: run, resumed, made again when stale, and put on a page."""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
import torch
import vl_convert

from ssil_data.cli import main
from ssil_trainers.algorithms.config import PAPER, TrainSettings
from ssil_trainers.collection.pure_pursuit import PurePursuit
from ssil_trainers.collection.rc_lidar import RCSettings
from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
from ssil_trainers.envs.registry import make_single
from ssil_trainers.experiments import reproduce as command
from ssil_trainers.experiments.cells import FIRST_TEST_SEED
from ssil_trainers.experiments.plan import Plan
from ssil_trainers.experiments.process_pool import open_pool
from ssil_trainers.experiments.publishing import publish
from ssil_trainers.experiments.results import Results
from ssil_trainers.experiments.tables import RC_LIDAR


def files(folder: Path) -> dict[str, int]:
    return {str(p): p.stat().st_mtime_ns for p in folder.rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory, swings_plan: Callable[[Path], Plan]) -> Plan:
    """A plan of one seed whose cells are all done, and published."""
    plan = swings_plan(tmp_path_factory.mktemp("reproduction"))
    store = plan.output.parent / "store"
    before = files(store)
    lines = list[str]()
    publish(plan, command.run_plan(plan, workers=1, report=lines.append))
    assert files(store) == before
    assert lines[0] == "0 of 9 cells are done already"
    assert lines[-1].startswith("cell 9 of 9")
    return plan


def done(plan: Plan) -> Results:
    found = [task.read_result() for task in plan.tasks]
    assert None not in found
    return Results([result for result in found if result is not None])


def test_every_cell_has_a_file_with_its_score_curve_and_identity(small: Plan):
    names = {path.stem for path in (small.output / "cells").iterdir()}
    trained = {f"swings-{m}-{n}-labels-seed-0" for m in ("gail", "clone") for n in (40, 80)}
    scored = {f"leverage-{preset}-vae-seed-0" for preset in ("default", "paper")}
    ssil = {f"swings-ssil-vae-{n}-labels-seed-0" for n in (40, 80)}
    assert names == trained | scored | ssil | {"swings-constant-seed-0"}
    cell = json.loads((small.output / "cells" / "swings-gail-40-labels-seed-0.json").read_text())
    assert [row["steps"] for row in cell["curve"]] == [0, 32, 64]
    returns = [found["returns"] for found in cell["tests"].values()]
    assert np.shape(returns) == (2, 2)
    assert all(len(set(episodes)) == 2 for episodes in returns)  # every episode its own start
    assert cell["score"] == pytest.approx(np.mean(returns) / -1000)
    assert cell["identity"]["dataset_version"] == small.source["swings"].version
    assert cell["identity"]["training"]["environments"] == 2
    assert (cell["full_score"], cell["recorded_return"], cell["laps"]) == (-1000.0, None, None)


def test_a_second_call_runs_nothing(small: Plan, monkeypatch: pytest.MonkeyPatch):
    before = files(small.output / "cells")
    monkeypatch.setattr(command, "open_pool", lambda workers: pytest.fail("something was run"))
    assert len(command.run_plan(replace(small), workers=1, report=lambda line: None).records) == 9
    assert files(small.output / "cells") == before


def test_a_cell_of_other_settings_data_or_code_is_not_taken_for_done(small: Plan):
    for other in (
        replace(small, training=replace(small.training, kl=0.02)),
        replace(small, budget=96),
        replace(small, preset="paper"),
        replace(small, tables=(replace(small.tables[0], episodes=3),)),
    ):
        missing = {task.cell.method for task in other.tasks if task.read_result() is None}
        assert "ssil" in missing
    task = next(task for task in small.tasks if task.cell.method == "gail")
    for name in ("code", "versions", "dataset_version"):
        assert replace(task, identity={**task.identity, name: "other"}).read_result() is None
    assert task.read_result() is not None


def test_a_setting_that_a_method_does_not_have_leaves_its_cells_as_they_are(small: Plan):
    other = replace(small, budget=96)
    clone = [task for task in other.tasks if task.cell.method == "clone"]
    assert clone
    assert all(task.read_result() is not None for task in clone)


def test_a_row_that_does_not_depend_on_labels_is_run_once_and_shown_for_all(small: Plan):
    rows = done(small).rows(small.tables[0])
    constant = [row for row in rows if row["method"] == "constant"]
    assert [row["labels"] for row in constant] == [40, 80]
    assert constant[0]["mean"] == constant[1]["mean"]


def test_tables_are_written_as_csv_with_settings_and_versions(small: Plan):
    def read(name: str) -> list[dict[str, str]]:
        return list(csv.DictReader((small.output / name).read_text().splitlines()))

    assert {row["method"] for row in read("swings.csv")} == {
        "gail",
        "ssil-vae",
        "constant",
        "clone",
    }
    assert {row["preset"] for row in read("leverage.csv")} == {"default", "paper"}
    assert {row["verdict"] for row in read("ledger.csv")} == {"not judged"}
    assert len([row for row in read("curves.csv") if row["method"] == "gail"]) == 2 * 3
    settings = json.loads((small.output / "settings.json").read_text())
    assert settings["tables"]["swings"]["training"]["steps"] == 64
    assert settings["versions"]["numpy"] == np.__version__
    assert settings["processor"]["architecture"]
    for name in ("index.html", "settings.json", "swings.csv"):
        assert str(small.output) not in (small.output / name).read_text()


def test_the_page_has_every_table_and_loads_nothing_from_a_network(small: Plan):
    html = (small.output / "index.html").read_text()
    for title in (
        "Table I: swings",
        "Table II",
        "Claims of the paper",
        "Controls",
        "SSIL (VAE)",
        "discount",
    ):
        assert title in html
    content = html.split("<script>")[0]
    assert not re.search(r"<(link|img|iframe|base|object|embed)\b", content)
    assert set(re.findall(r'(?:src|href|action)="([^"]*)"', content)) == {
        "#swings",
        "#leverage",
        "#claims",
        "#controls",
        "#settings",
    }
    assert "default-src 'none'" in html
    style = html[html.index("<style>") : html.index("</style>")]
    assert "url(" not in style and "@import" not in style


def test_every_chart_draws_a_panel_for_each_number_of_labels(small: Plan):
    html = (small.output / "index.html").read_text()
    specs = re.findall(r'<script type="application/json">(.*?)</script>', html)
    assert len(specs) == 2
    for spec, heading in zip(specs, ("Final scores", "Learning curves"), strict=True):
        svg = vl_convert.vegalite_to_svg(json.loads(spec))
        assert heading in svg
        for text in ("40 labels", "80 labels", "SSIL (VAE)"):
            assert f">{text}</text>" in svg


def test_workers_have_one_thread_and_are_stopped_by_ctrl_c():
    before = os.environ.get("OMP_NUM_THREADS")
    children = []
    with pytest.raises(KeyboardInterrupt), open_pool(1) as executor:
        assert executor.submit(os.getenv, "OMP_NUM_THREADS").result() == "1"
        assert executor.submit(torch.get_num_threads).result() == 1
        children = multiprocessing.active_children()
        sleeping = executor.submit(time.sleep, 600)
        while not sleeping.running():
            time.sleep(0.01)
        raise KeyboardInterrupt
    assert children
    assert not any(child.is_alive() for child in children)
    assert os.environ.get("OMP_NUM_THREADS") == before


def test_the_rc_expert_reaches_the_full_score_on_every_test_track():
    for test in RC_LIDAR.tests:
        env = make_single(test)
        expert = PurePursuit(cast(RCLidarEnv, env.unwrapped), ahead=RCSettings().ahead)
        state, _ = env.reset(seed=FIRST_TEST_SEED)
        total = 0.0
        ended = False
        while not ended:
            state, reward, terminated, truncated, _ = env.step(expert(state))
            total += float(reward)
            ended = terminated or truncated
        assert total == RC_LIDAR.full_score


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--seeds", "0"], "seeds: expected at least 1, found 0"),
        (["--first-seed", "-1"], "first-seed: expected at least 0, found -1"),
        (["--budget", "0"], "budget: expected at least 1, found 0"),
        (["--workers", "0"], "workers: expected at least 1, found 0"),
        (["--workers", "-1"], "workers: expected at least 1, found -1"),
        (["--labels", "7"], "labels: expected some of"),
        (["--methods", "magic"], "methods: expected some of"),
    ],
)
def test_settings_that_cannot_be_run_are_refused(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    with pytest.raises(SystemExit) as left:
        main(["reproduce", *words, "-o", str(tmp_path / "out")])
    assert left.value.code == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def planned(words: list[str], monkeypatch: pytest.MonkeyPatch) -> Plan:
    """Return the plan that the command would run."""
    plans: list[Plan] = []

    def caught(plan: Plan, **_: object) -> Results:
        plans.append(plan)
        return Results([])

    monkeypatch.setattr(command, "run_plan", caught)
    monkeypatch.setattr(command, "publish", lambda plan, results: {"reproduced": 0})
    with pytest.raises(SystemExit) as left:
        main(["reproduce", *words])
    assert left.value.code == 0
    return plans[0]


def test_the_default_seeds_are_three_that_no_setting_was_chosen_by(monkeypatch: pytest.MonkeyPatch):
    assert planned([], monkeypatch).seeds == (300, 301, 302)
    assert planned(["--first-seed", "7", "--seeds", "2"], monkeypatch).seeds == (7, 8)


def test_the_paper_preset_is_the_papers_leverage_and_loop(monkeypatch: pytest.MonkeyPatch):
    usual = planned([], monkeypatch)
    paper = planned(["--preset", "paper"], monkeypatch)
    assert (usual.preset, usual.training) == ("default", TrainSettings())
    assert (paper.preset, paper.training) == ("paper", replace(TrainSettings(), **PAPER))
    assert paper.training != usual.training


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--preset", "paper", "--training.gae-lambda", "0.97"],
            "--preset paper: has --training.gae-lambda 0.0; leave out --training.gae-lambda 0.97,",
        ),
        (
            ["--preset", "paper", "--training.centered"],
            "--preset paper: has --training.no-centered; leave out --training.centered,",
        ),
        (["--training.steps", "5"], "--training.steps: every table has its own, or those of --bud"),
        (["--training.seed", "0"], "--training.seed: the seeds are those of --first-seed"),
        (["--training.no-pretrained"], "--training.no-pretrained: every table has its own"),
        (["--training.evaluate-every", "5"], "--training.evaluate-every: every table has its own"),
    ],
)
def test_settings_of_training_that_would_be_replaced_are_refused(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    with pytest.raises(SystemExit) as left:
        main(["reproduce", *words, "-o", str(tmp_path / "out")])
    assert left.value.code == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_settings_of_training_as_the_preset_has_them_are_taken(monkeypatch: pytest.MonkeyPatch):
    words = ["--preset", "paper", "--training.gae-lambda", "0", "--training.kl", "0.02"]
    assert planned(words, monkeypatch).training == replace(TrainSettings(kl=0.02), **PAPER)


def test_coverage_is_run_on_demand_alone(monkeypatch: pytest.MonkeyPatch):
    assert "coverage" not in {table.name for table in planned([], monkeypatch).tables}
    (table,) = planned(["--table", "coverage", "--labels", "8"], monkeypatch).tables
    assert (table.name, table.labels) == ("coverage", (8,))


@pytest.mark.parametrize(
    "words",
    [
        ["--table", "rc-lidar"],
        ["--labels", "100"],
        ["--methods", "gail"],
        ["--seeds", "2"],
        ["--budget", "4096"],
        ["--preset", "paper"],
        ["--training.kl", "0.02"],
    ],
)
def test_only_the_whole_run_goes_into_the_documentation_by_default(
    words: list[str], monkeypatch: pytest.MonkeyPatch
):
    assert planned(words, monkeypatch).output == Path("reproduction")
    assert planned([*words, "-o", "else"], monkeypatch).output == Path("else")
    for whole in ([], ["--seeds", "5"], ["--first-seed", "400"], ["--workers", "1"]):
        assert planned(whole, monkeypatch).output == Path("docs/reproduction")


def test_only_the_chosen_labels_and_methods_are_run(monkeypatch: pytest.MonkeyPatch):
    words = ["--table", "racetrack", "--labels", "300", "--methods", "ssil", "--methods", "gail"]
    (table,) = planned(words, monkeypatch).tables
    assert (table.name, table.labels) == ("racetrack", (300,))
    assert {row.method for row in table.rows} == {"ssil", "gail"}


def test_tables_of_an_earlier_run_that_this_one_does_not_have_are_removed(
    small: Plan, tmp_path: Path
):
    for name in ("rc-lidar.csv", "leverage.csv", "mine.csv"):
        (tmp_path / name).write_text("old\n")
    publish(replace(small, output=tmp_path, leverage=None), Results([]))
    assert {path.name for path in tmp_path.glob("*.csv")} == {"mine.csv", "ledger.csv"}

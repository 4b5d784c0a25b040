"""The report is one offline page that is whole, escaped and deterministic."""

import json
import re
from pathlib import Path

import pytest
import vl_convert

from ssil_data.errors import InvalidInputError
from ssil_data.estimators import MDN, VAE
from ssil_data.quality import measure_quality
from ssil_data.report import write_report
from ssil_data.scales import MinMax
from ssil_data.scoring import Recipe, rescore, score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from support.demonstrations import drive
from support.report_page import create_plain, read_report, with_positions

QUICK = VAE(steps=20)
HOSTILE = "</script><script>alert('&1\")</script>"


def test_the_page_has_every_run_and_every_section(store: Store, tmp_path: Path):
    unlabeled = [
        with_positions(seed, tier=tier, score=seed / 10)
        for seed, tier in ((2, "0-25"), (3, "expert"), (4, "expert"))
    ]
    dataset = create_plain(store, [with_positions(1, labeled=True), *unlabeled])
    for name, estimator in (("first", QUICK), ("second", MDN(steps=20))):
        score(dataset, estimator, run=name)
    page = read_report(dataset, tmp_path)
    expected = ["runs", "trust", "histograms", "timelines", "map", "segments", "agreement"]
    assert page.sections == expected
    assert page.tags.count("script") == 5 + 2
    for expected in ("plain", dataset.version, "first", "second", "0-25", "AUROC", "epistemic"):
        assert expected in page.text


def test_the_page_asks_no_network_for_anything(dataset: Dataset, tmp_path: Path):
    score(dataset, QUICK)
    page = read_report(dataset, tmp_path)
    assert not {"link", "img", "iframe", "base", "object", "embed"} & set(page.tags)
    loads = [
        value for name, value in page.attributes if name in ("src", "href", "srcset", "action")
    ]
    assert loads
    assert all(value.startswith("#") for value in loads)
    style = re.search("<style>(.*?)</style>", (tmp_path / "report.html").read_text("utf-8"), re.S)
    assert style
    assert "url(" not in style[1]
    assert "@import" not in style[1]
    policy = next(value for name, value in page.attributes if "default-src" in value)
    assert "default-src 'none'" in policy


def test_names_that_users_gave_are_escaped(store: Store, tmp_path: Path):
    episodes = [drive(1, 30, labeled=True), drive(2, 30, tier=HOSTILE, source=HOSTILE, score=0.1)]
    dataset = create_plain(
        store, [*episodes, drive(3, 30, tier="expert", score=1.0)], (HOSTILE, "b", "c")
    )
    score(dataset, QUICK)
    page = read_report(dataset, tmp_path)
    assert page.tags.count("script") == 3 + 2
    assert page.text.count(HOSTILE) > 3
    assert HOSTILE not in (tmp_path / "report.html").read_text("utf-8")


def test_a_dataset_without_tiers_scores_and_positions_has_a_page(store: Store, tmp_path: Path):
    dataset = create_plain(store, [drive(seed, 30, labeled=seed == 0) for seed in range(3)])
    score(dataset, QUICK)
    page = read_report(dataset, tmp_path)
    assert "map" not in page.sections
    assert page.text.count("–") >= 4
    assert "unlabeled" in page.text
    assert "no quality tiers" in page.text


def test_a_dataset_of_labeled_episodes_alone_has_a_page(store: Store, tmp_path: Path):
    dataset = create_plain(store, [drive(seed, 30, labeled=True) for seed in range(2)])
    score(dataset, QUICK, run="one")
    score(dataset, Recipe(QUICK, MinMax()), run="two")
    assert "Every episode is labeled" in read_report(dataset, tmp_path).text


def test_a_dataset_without_labeled_episodes_has_a_page(
    dataset: Dataset, store: Store, tmp_path: Path
):
    unlabeled = create_plain(store, [drive(seed, 30) for seed in range(2)])
    for run in (score(dataset, QUICK), score(dataset, MDN(steps=20))):
        rescore(unlabeled, dataset, run.name)
    assert "0 in 0 episodes" in read_report(unlabeled, tmp_path).text


def test_the_run_of_the_best_auroc_is_shown_first(dataset: Dataset, tmp_path: Path):
    score(dataset, Recipe(VAE(steps=1, hidden=1, latent=1), MinMax()), run="poor")
    score(dataset, VAE(steps=300), run="good")
    aurocs = {
        run: measure_quality(dataset, dataset.leverage(run)).auroc or 0 for run in ("poor", "good")
    }
    assert aurocs["good"] > aurocs["poor"]
    assert "Shown first below: good" in read_report(dataset, tmp_path).text


def test_every_chart_draws_with_its_titles(store: Store, tmp_path: Path):
    dataset = create_plain(store, [with_positions(seed, labeled=seed == 0) for seed in range(3)])
    score(dataset, QUICK, run="one")
    score(dataset, Recipe(QUICK, MinMax()), run="two")
    write_report(dataset, tmp_path / "report.html")
    html = (tmp_path / "report.html").read_text("utf-8")
    specs = re.findall(r'<script type="application/json">(.*?)</script>', html)
    drawn = [vl_convert.vegalite_to_svg(json.loads(spec)) for spec in specs]
    expected = [
        ("Leverage by group and run", "Share of pairs, %", "Leverage"),
        ("Leverage over time: one", "Step of the episode", "Group (episodes)"),
        ("Leverage on the map: one", "x, m", "y, m"),
        ("Agreement between runs", "Run", "Rank correlation"),
    ]
    for svg, titles in zip(drawn, expected, strict=True):
        for title in titles:
            assert f">{title}</text>" in svg


def test_many_episodes_are_capped_and_the_page_says_so(store: Store, tmp_path: Path):
    dataset = create_plain(store, [drive(seed, 4, labeled=seed < 9) for seed in range(400)])
    score(dataset, QUICK)
    assert "320 of 400 episodes are shown" in read_report(dataset, tmp_path).text


def test_a_dataset_without_runs_is_refused(dataset: Dataset, tmp_path: Path):
    with pytest.raises(InvalidInputError, match="score it first"):
        write_report(dataset, tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


def test_a_missing_folder_is_named(dataset: Dataset, tmp_path: Path):
    score(dataset, QUICK)
    with pytest.raises(InvalidInputError, match=r"the folder .*nowhere does not exist"):
        write_report(dataset, tmp_path / "nowhere" / "report.html")
    with pytest.raises(InvalidInputError, match="is a folder; name a file"):
        write_report(dataset, tmp_path)


def test_the_same_store_gives_the_same_bytes_and_leaves_no_other_file(
    dataset: Dataset, tmp_path: Path
):
    score(dataset, QUICK)
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "report.html").write_text("an older report")
    seen: list[tuple[str, int, int]] = []
    write_report(dataset, folder / "report.html", progress=lambda *step: seen.append(step))
    first = (folder / "report.html").read_bytes()
    write_report(dataset, folder / "report.html")
    assert (folder / "report.html").read_bytes() == first
    assert [path.name for path in folder.iterdir()] == ["report.html"]
    assert seen[-1] == ("explain", 1, 1)


def test_a_failure_leaves_the_older_report(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    score(dataset, QUICK)
    output = tmp_path / "report.html"
    output.write_text("an older report")
    monkeypatch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        write_report(dataset, output)
    assert output.read_text() == "an older report"
    assert [path.name for path in tmp_path.iterdir() if "report" in path.name] == ["report.html"]

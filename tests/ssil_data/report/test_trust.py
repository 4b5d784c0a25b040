"""The report says how far each run can be trusted, beside the truth, and marks weak ones."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import vl_convert

from ssil_data.estimators import GPR, VAE, Ensemble, WindowVAE
from ssil_data.pooling import HiddenMarkov, Window
from ssil_data.report import write_report
from ssil_data.report.evidence import Evidence
from ssil_data.report.trust import describe_trust
from ssil_data.scales import Quantile
from ssil_data.scoring import Recipe, preset, score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import UNCHECKED
from support.command_line import run
from support.demonstrations import drive
from support.report_page import create_plain, read_report, silent

GAUSSIAN = preset("default", "gpr")
SOUND = replace(GAUSSIAN, scale=Quantile())
"""Of a scale without a share of experts: so few pairs do not say it."""


def read_specs(folder: Path) -> list[dict]:
    html = (folder / "report.html").read_text("utf-8")
    found = re.findall(r'<script type="application/json">(.*?)</script>', html)
    return [json.loads(spec) for spec in found]


def test_the_section_about_trust_has_what_a_run_says_and_what_is_true(
    dataset: Dataset, tmp_path: Path
):
    run = score(dataset, GAUSSIAN)
    page = read_report(dataset, tmp_path)
    assert "trust" in page.sections
    assert run.expert_share is not None
    assert f"{run.expert_share:.3f}" in page.text
    described = describe_trust(Evidence.of(dataset, silent))
    (row,) = described["health"]
    assert row["true_share"] == pytest.approx(150 / 300)
    assert row["perfect"] == pytest.approx(1 - run.expert_share / 2)
    for words in ("Expert share", "Effective pairs", "Held-out AUROC", "90 % interval"):
        assert words in page.text


def test_a_run_that_knows_nothing_of_itself_has_dashes(dataset: Dataset, tmp_path: Path):
    score(dataset, VAE(steps=20))
    (row,) = describe_trust(Evidence.of(dataset, silent))["health"]
    assert (row["share"], row["interval"], row["auroc"], row["perfect"]) == (None,) * 4
    assert "Estimated expert share" not in read_report(dataset, tmp_path).text


def test_a_held_out_auroc_that_is_not_known_is_told_by_the_word_of_the_command(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    held_out = score(dataset, SOUND, run="checked").held_out_auroc
    score(dataset, VAE(steps=20), run="plain")
    write_report(dataset, tmp_path / "report.html")
    html = (tmp_path / "report.html").read_text("utf-8")
    section = html.split('<section id="trust">')[1].split("</section>")[0]
    cells = {
        row.split("<")[0]: re.findall(r'<td class="number">([^<]*)</td>', row)
        for row in section.split('class="name">')[1:]
    }
    assert run("show", dataset.name, "--store", dataset.folder.uri.rsplit("/", 1)[0]) == 0
    assert UNCHECKED in capsys.readouterr().out
    assert cells["plain"][-2] == UNCHECKED
    assert cells["checked"][-2] == f"{held_out:.3f}"
    assert f"“{UNCHECKED}”: none were held out" in section


def test_a_weak_run_is_marked_with_its_reasons_at_the_top_of_its_sections(
    dataset: Dataset, tmp_path: Path
):
    assert not score(dataset, SOUND, run="sound").weak
    weak = score(dataset, GAUSSIAN, labels=2, run="frail")
    assert weak.weak
    page = read_report(dataset, tmp_path)
    assert "frail is weak" in page.text
    assert "sound is weak" not in page.text
    reasons = "; ".join(weak.weak)
    # above the page's sections, in the one about runs, and above the run's segments
    assert page.text.count(reasons) == 3
    assert re.search(r"Under frail\s+Weak: ", page.text)


def test_the_calibration_curve_and_the_shares_are_drawn(dataset: Dataset, tmp_path: Path):
    run = score(dataset, GAUSSIAN, run="pooled")
    score(dataset, VAE(steps=20), run="plain")
    write_report(dataset, tmp_path / "report.html")
    (spec,) = [spec for spec in read_specs(tmp_path) if "curves" in spec["datasets"]]
    svg = vl_convert.vegalite_to_svg(spec)
    for title in ("True share of experts", "Leverage", "Estimated expert share, every run"):
        assert f">{title}</text>" in svg
    curve = [row for row in spec["datasets"]["curves"] if row["key"] == "r0"]
    assert sum(row["pairs"] for row in curve) == 300
    assert [row["leverage"] for row in curve] == sorted(row["leverage"] for row in curve)
    (share,) = spec["datasets"]["shares"]
    assert (share["run"], share["truth"]) == ("pooled", 0.5)
    assert share["low"] <= share["share"] <= share["high"]
    assert share["share"] == round(run.expert_share or 0, 4)


def test_without_tiers_there_is_no_curve_and_the_page_says_so(store: Store, tmp_path: Path):
    unlabeled = [drive(seed, 40, spread=1 + 9 * (seed > 2)) for seed in range(1, 6)]
    dataset = create_plain(store, [drive(0, 40, labeled=True), *unlabeled])
    score(dataset, GAUSSIAN)
    page = read_report(dataset, tmp_path)
    assert "There is no calibration curve" in page.text
    assert "true" not in page.text.split("How far each run")[1].split("How leverage is")[0]
    (spec,) = [spec for spec in read_specs(tmp_path) if "shares" in spec["datasets"]]
    assert "curves" not in spec["datasets"]
    assert "Estimated expert share" in vl_convert.vegalite_to_svg(spec)


def test_strips_of_a_run_that_pools_stand_beside_those_of_each_pair_alone(
    dataset: Dataset, tmp_path: Path
):
    score(dataset, GAUSSIAN, run="pooled")
    score(dataset, VAE(steps=20), run="plain")
    write_report(dataset, tmp_path / "report.html")
    (spec,) = [spec for spec in read_specs(tmp_path) if "strips" in spec["datasets"]]
    svg = vl_convert.vegalite_to_svg(spec)
    for title in ("each pair alone", "pooled over time: the leverage", "Group (episodes)"):
        assert f">{title}</text>" in svg
    row = spec["datasets"]["strips"][0]
    assert "r0alone" in row
    assert "r1alone" not in row
    assert len(row["r0alone"]) == len(row["r0"])


@pytest.mark.parametrize("pooling", [Window(half_width=5), HiddenMarkov(bins=4)])
def test_judged_alone_is_what_the_model_gives_pairs_that_come_one_by_one(dataset: Dataset, pooling):
    score(dataset, replace(GAUSSIAN, pooling=pooling))
    evidence = Evidence.of(dataset, silent)
    model = dataset.model("gpr")
    pairs = dataset.pairs()
    one_by_one = [model(pairs[i : i + 1]).leverage[0] for i in range(0, len(pairs), 41)]
    np.testing.assert_allclose(evidence.alone["r0"][::41], one_by_one, atol=1e-5)


def test_a_run_without_pooling_has_one_strip(dataset: Dataset, tmp_path: Path):
    score(dataset, Recipe(GPR(surprisal=True)))
    assert Evidence.of(dataset, silent).alone == {}
    write_report(dataset, tmp_path / "report.html")
    (spec,) = [spec for spec in read_specs(tmp_path) if "strips" in spec["datasets"]]
    assert "each pair alone" not in vl_convert.vegalite_to_svg(spec)


def test_reasons_of_an_ensemble_are_those_of_its_members_that_have_some(
    dataset: Dataset, tmp_path: Path
):
    members = (GPR(surprisal=True, steps=5), WindowVAE(steps=20))
    score(dataset, replace(GAUSSIAN, estimator=Ensemble(members)))
    text = read_report(dataset, tmp_path).text
    assert "reconstruction error of the members that have one" in text
    assert "epistemic" not in text

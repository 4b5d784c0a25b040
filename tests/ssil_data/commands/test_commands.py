"""The command does the job from a shell: exit status, JSON, one message for a mistake."""

import io
import json
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from ssil_data.cli import app, main
from ssil_data.commands.leverage import Kind, PoolingKind, PresetName, ScaleKind
from ssil_data.estimators import ESTIMATORS
from ssil_data.pooling import POOLINGS
from ssil_data.scales import SCALES
from ssil_data.scoring import PRESETS
from support.demonstrations import drives


def arrays() -> dict[str, np.ndarray]:
    episodes = drives()
    lengths = [len(episode) for episode in episodes]
    return {
        "states": np.concatenate([episode.states for episode in episodes]),
        "actions": np.concatenate([episode.actions for episode in episodes]),
        "episode": np.repeat(np.arange(len(episodes)), lengths),
        "labeled": np.repeat([episode.labeled for episode in episodes], lengths),
        "tier": np.repeat([str(episode.tier) for episode in episodes], lengths),
        "score": np.repeat([episode.score or 0.0 for episode in episodes], lengths),
    }


class Shell:
    """Runs commands in this process against one store."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
        self.folder, self._capsys = folder, capsys
        monkeypatch.setenv("SSIL_STORE", str(folder / "store"))
        np.savez(folder / "drives.npz", **arrays())

    def __call__(self, *words: object) -> str:
        status, out, err = self.run(*words)
        assert status == 0, err
        return out

    def json(self, *words: object) -> Any:
        return json.loads(self(*words, "--json"))

    def refused(self, *words: object) -> str:
        before = sorted(self.folder.rglob("*"))
        status, out, err = self.run(*words)
        assert (status, out) == (2, "")
        assert sorted(self.folder.rglob("*")) == before
        return err

    def run(self, *words: object) -> tuple[int, str, str]:
        status = 0
        try:
            main([str(word) for word in words])
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 0
        captured = self._capsys.readouterr()
        return status, captured.out, captured.err


@pytest.fixture
def shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> Shell:
    return Shell(tmp_path, monkeypatch, capsys)


@pytest.fixture
def scored(shell: Shell) -> Shell:
    shell("import", shell.folder / "drives.npz", "--name", "drives")
    shell("score", "drives", "--estimator", "gpr")
    return shell


def test_help_names_every_command(shell: Shell):
    out = shell("--help")
    commands = [name for name in app if not name.startswith("-")]
    assert len(commands) >= 15
    for command in (*commands, "--version", "--install-completion"):
        assert command in out


def test_help_imports_neither_torch_nor_arrow():
    code = (
        "import sys; sys.argv = ['ssil-data', '--help']\n"
        "from ssil_data.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "print([m for m in ('torch', 'pyarrow', 'numpy', 'altair') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("command", [c for c in app if not c.startswith("-")])
def test_every_command_has_help(shell: Shell, command: str):
    assert "Usage: ssil-data" in shell(command, "--help")


def test_choices_of_the_command_line_are_the_registries():
    assert get_args(Kind) == tuple(ESTIMATORS)
    assert set(get_args(ScaleKind)) == set(SCALES)
    assert get_args(PoolingKind) == tuple(POOLINGS)
    assert get_args(PresetName) == PRESETS


def test_import_score_show_as_json(shell: Shell):
    row = shell.json("import", shell.folder / "drives.npz", "--name", "drives")
    assert (row["dataset"], row["episodes"], row["labeled"]) == ("drives", 11, 120)
    assert [d["dataset"] for d in shell.json("datasets")["datasets"]] == ["drives"]
    for preset in ("default", "paper"):
        run = shell.json(
            "score",
            "drives",
            "--estimator",
            "gpr",
            "--preset",
            preset,
            "--seed",
            5,
            "--run",
            preset,
        )
        expected = {
            "run": preset,
            "dataset": "drives",
            "estimator": "gpr",
            "preset": preset,
            "seed": 5,
        }
        assert {key: run[key] for key in expected} == expected
        assert run["dataset_version"] == row["version"]
        assert run["pairs"] == row["pairs"]
        assert run["scale"] == {"default": "posterior", "paper": "minmax"}[preset]
        assert run["pooling"] == {"default": "window", "paper": "none"}[preset]
        assert run["seconds"] > 0
    shown = shell.json("show", "drives")["runs"]
    assert [run["run"] for run in shown] == ["default", "paper"]
    for run in shown:
        assert list(run["mean_leverage_by_tier"]) == ["0-25", "50-75", "expert"]
        assert 0.5 < run["auroc"] <= 1
        assert 0.5 < run["auroc_length_matched"] <= 1
        assert -1 <= run["spearman"] <= 1


def test_tables_for_people_have_a_row_per_run(scored: Shell):
    out = scored("show", "drives")
    assert "gpr" in out
    assert "AUROC" in out
    assert "drives" in scored("datasets")


def test_lcor_from_files_of_any_kind_and_along_an_episode(scored: Shell):
    states = arrays()["states"][:7]
    np.save(scored.folder / "states.npy", states)
    np.savez(scored.folder / "states.npz", states=states)
    np.savetxt(scored.folder / "states.csv", states, delimiter=",", header="a,b,c", comments="")
    answers = [
        scored.json("lcor", "drives", "--run", "gpr", "--states", scored.folder / f"states.{kind}")
        for kind in ("npy", "npz", "csv")
    ]
    assert set(answers[0]) == {"alpha", "lcor", "effective_sample_size", "half_width"}
    assert answers[0]["lcor"] == answers[1]["lcor"] == pytest.approx(answers[2]["lcor"])
    along = scored.json("lcor", "drives", "--run", "gpr", "--episode", 0, "--alpha", 3)
    assert along["alpha"] == 3
    assert len(along["lcor"]) == 60
    top = scored.json("lcor", "drives", "--run", "gpr", "--episode", 0, "--contributors", 2)
    assert top["contributors"][5][0]["episode"] == 0
    assert top["contributors"][5][0]["step"] == 5
    assert "LCoR" in scored("lcor", "drives", "--run", "gpr", "--episode", 0)


def test_a_fitted_run_scores_again_and_another_dataset(scored: Shell):
    again = scored.json("score", "drives", "--fitted", "gpr")
    assert (again["run"], again["estimator"]) == ("gpr-2", "gpr")
    scored("import", scored.folder / "drives.npz", "--name", "other", "--labeled", 5)
    assert scored.json("score", "other", "--fitted", "drives/gpr")["dataset"] == "other"


def test_appending_makes_runs_of_the_earlier_version_refused(scored: Shell):
    scored("import", scored.folder / "drives.npz", "--name", "drives", "--append")
    assert scored.json("show", "drives")["runs"] == []
    assert "earlier versions" in scored("show", "drives")
    np.save(scored.folder / "s.npy", arrays()["states"][:2])
    message = scored.refused("lcor", "drives", "--run", "gpr", "--states", scored.folder / "s.npy")
    assert "expected one made from version" in message


def test_validate_finds_a_flipped_bit(scored: Shell):
    assert "every file is as it was written" in scored("validate", "drives")
    (path,) = (scored.folder / "store" / "drives" / "leverage").rglob("*.parquet")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)
    status, out, _ = scored.run("validate", "drives", "--json")
    assert status == 1
    assert path.name in json.loads(out)["damaged"][0]


def test_mistakes_get_one_message_and_status_2_and_write_nothing(scored: Shell):
    drives_file = scored.folder / "drives.npz"
    np.save(scored.folder / "narrow.npy", np.ones((2, 2)))
    np.save(scored.folder / "nan.npy", np.full((2, 3), np.nan))
    np.save(scored.folder / "states.npy", np.ones((2, 3)))
    bad = {**arrays(), "states": np.full((330, 3), np.inf)}
    np.savez(scored.folder / "bad.npz", **{k: v[: len(bad["states"])] for k, v in bad.items()})
    ask = ("lcor", "drives", "--run", "gpr", "--states")
    cases = {
        "found 'other'": ("show", "other"),
        "leave out ['--preset', '--seed']": (
            *("score", "drives", "--fitted", "gpr", "--preset", "paper", "--seed", 7),
        ),
        "expected ['states[0]', 'states[1]', 'states[2]'] as in the dataset": (
            *("import", drives_file, "--name", "drives", "--append", "--state", "score"),
        ),
        "expected a folder or s3://": ("show", "drives", "--store", "foo://bar"),
        "Not a directory": ("show", "drives", "--store", "/etc/passwd"),
        "dataset name": ("score", "../drives", "--estimator", "vae"),
        "run name": ("score", "drives", "--estimator", "gpr", "--run", "../x"),
        "preset paper: expected one of the paper's estimators": (
            *("score", "drives", "--preset", "paper", "--estimator", "contrast"),
        ),
        "found half": ("score", "drives", "--expert-share", "half"),
        "expected 0 < share < 1, found 1.0": ("score", "drives", "--expert-share", "1"),
        "only the posterior scale takes one": (
            *("score", "drives", "--scale", "quantile", "--expert-share", ".5"),
        ),
        "only the posterior scale estimates one, the scale is quantile": (
            *("score", "drives", "--scale", "quantile", "--expert-share", "auto"),
        ),
        "only the posterior scale estimates one, the scale is minmax": (
            *("score", "drives", "--preset", "paper", "--estimator", "vae"),
            *("--expert-share", "auto"),
        ),
        "scale_floor: expected 0 or more, found -1": ("score", "drives", "--scale-floor=-1"),
        "from 2 to 120, the labeled pairs, found 1": ("score", "drives", "--labels", "1"),
        "from 2 to 120, the labeled pairs, found 121": ("score", "drives", "--labels", "121"),
        "leave out ['--pool', '--expert-share', '--labels']": (
            *("score", "drives", "--fitted", "gpr", "--pool", "none"),
            *("--expert-share", "auto", "--labels", 7),
        ),
        "the name 'drives' is taken": ("import", drives_file, "--name", "drives"),
        "found 'z'": ("import", drives_file, "--name", "new", "--state", "z"),
        "row 0, column 'states'[0]": ("import", scored.folder / "bad.npz", "--name", "new"),
        "expected width 3, found 2": (*ask, scored.folder / "narrow.npy"),
        "found nan at row 0": (*ask, scored.folder / "nan.npy"),
        "expected a finite number > 0, found 0": (
            *ask,
            scored.folder / "states.npy",
            "--alpha",
            "0",
        ),
        "found -1": (*ask, scored.folder / "states.npy", "--alpha=-1"),
        "found 'nope'": ("lcor", "drives", "--run", "nope", "--episode", 0),
        "expected 0 to 10": ("lcor", "drives", "--run", "gpr", "--episode", 11),
        "found both": (*ask, scored.folder / "states.npy", "--episode", 0),
        "missing.csv does not exist": ("import", scored.folder / "missing.csv", "--name", "new"),
    }
    for expected, words in cases.items():
        message = scored.refused(*words)
        assert expected in message, (words, message)
        assert len(message.strip().splitlines()) == 1, message
    for words in (("score", "drives", "--estimator", "pca"), ("score",), ("nothing",)):
        status, _, _ = scored.run(*words)
        assert status == 2


def test_version_is_that_of_the_package(shell: Shell):
    assert shell("--version").strip() == version("ssil-data")


@pytest.mark.parametrize("kind", ["bash", "zsh", "fish"])
def test_completion_knows_every_command_and_its_options(shell: Shell, kind: str):
    script = shell.folder / "completion"
    before = os.environ.get("HOME")
    os.environ["HOME"] = str(shell.folder)
    try:
        shell("--install-completion", "--shell", kind, "--output", script)
    finally:
        if before is not None:
            os.environ["HOME"] = before
    text = script.read_text()
    for name in app:
        if not name.startswith("-"):
            assert name in text
    assert "contributors" in text


def test_the_example_can_be_scored_shown_and_reported_at_once(shell: Shell):
    row = shell.json("example", "--name", "tried")
    assert (row["dataset"], row["pairs"], row["episodes"]) == ("tried", 14_350, 51)
    assert row["labeled"] == 1_200
    shell("score", "tried", "--estimator", "vae", "--preset", "paper")
    (run,) = shell.json("show", "tried")["runs"]
    assert run["auroc"] > 0.95
    means = run["mean_leverage_by_tier"]
    assert means["0-25"] < means["25-50"] < means["50-75"] < means["expert"]
    shell("report", "tried", "-o", shell.folder / "tried.html")
    assert (shell.folder / "tried.html").stat().st_size > 100_000
    assert "'tried'" in shell.refused("example", "--name", "tried")
    assert "ssil-data score racetrack-example" in shell("example")


def test_card_prints_where_the_demonstrations_come_from(scored: Shell):
    out = scored("card", "drives")
    assert out.startswith("# drives\n")
    assert "Imported from `drives.npz`: 11 episodes" in out
    assert "found 'other'" in scored.refused("card", "other")


class Terminal(io.StringIO):
    """Standard input that is a terminal, with what a person types."""

    def isatty(self) -> bool:
        return True


def test_delete_with_yes_deletes_the_dataset_and_its_runs(scored: Shell):
    assert scored("delete", "drives", "--yes") == "Deleted drives\n"
    assert scored.json("datasets") == {"datasets": []}
    assert not (scored.folder / "store" / "drives").exists()


def test_delete_without_a_terminal_and_without_yes_is_refused(
    scored: Shell, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(sys, "stdin", io.StringIO("drives\n"))
    assert "add --yes" in scored.refused("delete", "drives")
    assert "found 'other'" in scored.refused("delete", "other", "--yes")


@pytest.mark.parametrize("typed", ["", "\n", "y\n", "other\n"])
def test_delete_keeps_the_dataset_unless_its_name_is_typed(
    scored: Shell, monkeypatch: pytest.MonkeyPatch, typed: str
):
    monkeypatch.setattr(sys, "stdin", Terminal(typed))
    status, out, _ = scored.run("delete", "drives")
    assert status == 1
    assert "Pairs: 420. Runs: 1." in out
    assert "drives was not deleted" in out
    assert [d["dataset"] for d in scored.json("datasets")["datasets"]] == ["drives"]


def test_delete_asks_for_the_name_on_a_terminal(scored: Shell, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys, "stdin", Terminal("drives\n"))
    assert "Deleted drives" in scored("delete", "drives")
    assert scored.json("datasets") == {"datasets": []}


def test_scoring_without_a_labeled_episode_says_so(shell: Shell):
    given = {name: array for name, array in arrays().items() if name != "labeled"}
    np.savez(shell.folder / "plain.npz", **given)
    out = shell("import", shell.folder / "plain.npz", "--name", "plain")
    assert "No episode is labeled" in out
    assert "expected at least one" in shell.refused("score", "plain", "--estimator", "vae")


def test_the_installed_command_runs(tmp_path: Path):
    command = Path(sys.executable).with_name("ssil-data")
    environment = {**os.environ, "SSIL_STORE": str(tmp_path)}
    run = subprocess.run(
        [command, "datasets", "--json"], capture_output=True, text=True, check=True, env=environment
    )
    assert json.loads(run.stdout) == {"datasets": []}

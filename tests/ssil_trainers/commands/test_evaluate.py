"""The command evaluate, on Pendulum."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ssil_data.store.dataset import Dataset
from support.command_line import SHORT_TRAINING, run


def test_a_video_has_a_frame_for_every_step(
    pendulum: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    imageio = pytest.importorskip("imageio.v2")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pytest.importorskip("pygame")
    train = ["train", "clone", "--env", "Pendulum-v1", "--dataset", "swings"]
    assert run(*train, *SHORT_TRAINING, "-o", tmp_path) == 0
    video = tmp_path / "videos" / "one.mp4"
    assert run("evaluate", tmp_path / "policy.safetensors", "--episodes", 1, "--video", video) == 0
    with imageio.get_reader(video) as frames:
        assert frames.count_frames() == 200
        assert np.ptp(frames.get_data(10)) > 0
    assert "video: 200 of 200" in capsys.readouterr().err
    assert run("evaluate", tmp_path / "policy.safetensors", "--video", "one.gif") == 2
    shown = capsys.readouterr().err
    assert "ending in .mp4, found one.gif" in shown and "drive" not in shown


def test_a_policy_for_other_states_is_refused(
    pendulum: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    train = ["train", "clone", "--env", "Pendulum-v1", "--dataset", "swings"]
    assert run(*train, *SHORT_TRAINING, "-o", tmp_path) == 0
    policy = tmp_path / "policy.safetensors"
    assert run("evaluate", policy, "--env", "MountainCarContinuous-v0") == 2
    assert "shapes ((2,), (1,)) of the environment, found ((3,), (1,))" in capsys.readouterr().err

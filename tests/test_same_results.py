"""Scores, leverage, LCoR and trained policies of the committed sets, bit for bit as at 0.1.0.

The digests in `support/digests.json` were taken before the modules were moved. Bits depend on the
processor: torch, BLAS and the kernels choose their instructions by it.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numpy as np
import pytest
import torch
from safetensors.numpy import load_file
from threadpoolctl import threadpool_limits

import ssil_data as sd
from ssil_data.cli import main
from support.demonstrations import DATASETS, ROOT

KNOWN: dict[str, dict[str, Any]] = json.loads((ROOT / "tests/support/digests.json").read_text())
PROCESSOR = f"{llvm.get_host_cpu_name()} torch {torch.__version__}"
DIGESTS = KNOWN.get(PROCESSOR, next(iter(KNOWN.values())))

pytestmark = pytest.mark.skipif(
    PROCESSOR not in KNOWN, reason=f"digests are known for {sorted(KNOWN)}, not for {PROCESSOR}"
)


def digest(*arrays: np.ndarray | bytes) -> str:
    whole = hashlib.sha256()
    for array in arrays:
        whole.update(array if isinstance(array, bytes) else np.ascontiguousarray(array).tobytes())
    return whole.hexdigest()[:32]


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> sd.Store:
    """A copy of the committed store."""
    return sd.Store(shutil.copytree(DATASETS, tmp_path_factory.mktemp("committed") / "store"))


def recipe_of_before(kind: str) -> sd.Recipe:
    """Return the preset `default` of 0.1.0: the quantile scale, and surprisal of an mdn."""
    return sd.Recipe(
        sd.MDN(surprisal=True) if kind == "mdn" else sd.preset("paper", kind).estimator
    )


@pytest.mark.parametrize("which", DIGESTS["scored"])
def test_leverage_and_model_are_those_of_before(which: str, store: sd.Store):
    name, kind, preset = which.split()
    dataset = store[name]
    recipe = sd.preset("paper", kind) if preset == "paper" else recipe_of_before(kind)
    with threadpool_limits(2):  # as when the digests were taken: the bits of a GPR depend on it
        run = sd.score(dataset, recipe, seed=0)
    found = {"leverage": digest(dataset.leverage(run.name)), "model": run.model}
    assert found == DIGESTS["scored"][which]


@pytest.mark.parametrize("name", ["racetrack", "rc-lidar"])
def test_lcor_and_cor_are_those_of_before(name: str, store: sd.Store):
    dataset = store[name]
    run = sd.score(dataset, sd.WindowVAE(), seed=0)
    field = dataset.field(run.name)
    queries = dataset.pairs().states[::97]
    exact = field.lcor(queries)
    sampled = field.lcor(queries[:64], tolerance=0.05, seed=1)
    known = DIGESTS["lcor"]
    assert digest(exact.values, exact.effective_sample_size) == known[f"{name} lcor"]
    assert digest(field.cor(queries)) == known[f"{name} cor"]
    assert digest(sampled.values, sampled.half_width) == known[f"{name} lcor sampled"]


@pytest.mark.parametrize("which", DIGESTS["trained"])
def test_a_trained_policy_is_that_of_before(which: str, store: sd.Store, tmp_path: Path):
    name, method = which.split()
    if "vae" not in store[name].runs.names():
        sd.score(store[name], sd.VAE(), seed=0, run="vae")
    words = ["train", method, "--env", name, "--dataset", name, "--store", store.folder.uri]
    words += ["--steps", "512", "--environments", "4", "--horizon", "32", "--evaluations", "1"]
    words += ["--cloning-steps", "20", "-o", str(tmp_path)]
    words += ["--run", "vae"] if method in ("ssil", "mixgail") else []
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 0
    arrays = load_file(tmp_path / "policy.safetensors")
    parts = [part for key in sorted(arrays) for part in (key.encode(), arrays[key])]
    assert digest(*parts) == DIGESTS["trained"][which]

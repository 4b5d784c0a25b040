"""Adam takes the steps of torch, without what torch would import for them."""

import subprocess
import sys

import torch

from ssil_data.estimators.learning.adam import Adam
from ssil_data.estimators.learning.descent import network, reproducible

STEPS = 60


def test_steps_are_those_of_torch_bit_for_bit():
    with reproducible(seed=0):
        ours = network(5, 16, 3)
        inputs = torch.randn(40, 5)
    torchs = network(5, 16, 3)
    torchs.load_state_dict(ours.state_dict())
    adam = Adam(ours.parameters(), steps=STEPS, rate=0.01)
    optimizer = torch.optim.Adam(torchs.parameters(), lr=0.01, fused=True)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
    for _ in range(STEPS):
        before = [weight.clone() for weight in ours.parameters()]
        adam.step(ours(inputs).square().mean())
        optimizer.zero_grad()
        torchs(inputs).square().mean().backward()
        optimizer.step()
        schedule.step()
        pairs = zip(ours.parameters(), torchs.parameters(), strict=True)
        assert all(torch.equal(one, other) for one, other in pairs)
        changed = zip(before, ours.parameters(), strict=True)
        assert not any(torch.equal(one, other) for one, other in changed)


def test_fits_do_not_wait_for_torchs_compiler():
    code = """
import sys
import numpy as np
import ssil_data as sd
from ssil_data.demonstrations import Pairs
rng = np.random.default_rng(0)
episode, step = np.divmod(np.arange(60), 30)
pairs = Pairs(rng.normal(size=(60, 3)), rng.normal(size=(60, 2)), episode, step)
few = (sd.GPR(steps=2), sd.MDN(steps=2), sd.WindowVAE(steps=2), sd.Contrast(steps=2))
sd.Ensemble(few).fit(pairs, seed=0, unlabeled=sd.UnlabeledSample.of(pairs))
sys.exit(not ("torch" in sys.modules and "torch._dynamo" not in sys.modules))
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

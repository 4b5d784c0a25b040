"""Labeled pairs are held out by whole episodes."""

import numpy as np

from ssil_data.demonstrations import Pairs
from ssil_data.estimators import ESTIMATORS
from ssil_data.scoring import split_held_out

KINDS = sorted(ESTIMATORS)


def test_a_held_out_split_keeps_episodes_whole():
    episode = np.repeat(np.arange(10), 30)
    step = np.tile(np.arange(30), 10)
    pairs = Pairs(np.ones((300, 2)), np.ones((300, 1)), episode, step)
    fit, held_out = split_held_out(pairs, share=0.2, seed=1)
    assert not set(fit.episode) & set(held_out.episode)
    assert len(fit) + len(held_out) == 300
    assert len(held_out) in (60, 90)
    fit, held_out = split_held_out(pairs[:30], share=0.2, seed=1)
    assert (len(fit), len(held_out)) == (24, 6)

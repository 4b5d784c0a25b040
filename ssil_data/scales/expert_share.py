"""How many of the unlabeled pairs are the expert's: the share, its interval, and where to cut.

Two kinds of evidence are joined. Where the experts are a group of their own, the density of pooled
uncertainty has a valley beside them. And labeled pairs that were held out say where experts lie:
of those as far as their q-quantile, a share q of all experts should be there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

BINS = 256
BANDWIDTH = 0.6
"""Times Silverman's rule, which is for one group and blurs two."""
DEEPEST = 0.02
"""Depths below this are all the same evidence."""
FARTHEST = 10
"""Values farther from the quartiles than so many times what lies between them count as there."""
SHALLOWEST = 0.6
"""A valley is at most so high, the lower of its two sides being 1."""
LEVELS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Quantiles of the held-out labeled pairs that the share is read at."""
LOWEST_LEVEL = 0.1
"""A further one, which is less certain, that its lower bound is read at too."""
HIGHEST = 2
"""So many of the levels, the highest, say most where there are labels enough."""
ENOUGH = 2.0
"""Independent labeled pairs above which the highest levels are believed, more and more."""
PLENTY = 30.0
"""Independent labeled pairs above which the prior denies less and less what they speak for."""
FAR_TOO_FEW = 5.0
"""A valley that leaves this many times fewer than the labels bound is a gap amid the experts."""


@dataclass(frozen=True, eq=False)
class Density:
    """Smoothed density of the unlabeled pairs.

    Parameters
    ----------
    centers
        Of the bins, (`BINS`,).
    counts
        Pairs in each bin.
    smooth
        The same, smoothed, as shares.
    width
        Deviation of the smoothing.
    """

    centers: NDArray[np.float64]
    counts: NDArray[np.float64]
    smooth: NDArray[np.float64]
    width: float

    @classmethod
    def of(cls, values: NDArray[np.float64], *, independent: float) -> Density:
        """Estimate the density of values.

        Parameters
        ----------
        values
            (n,), not all equal.
        independent
            How many independent values they count as.

        Source
        ------
        Silverman, Density Estimation, 1986.
        """
        quartiles = np.quantile(values, [0.25, 0.75])
        between = quartiles[1] - quartiles[0]
        low = values.min()
        high = values.max()
        if between > 0:
            # bins are of one width, and a single outlier would leave all others one of them
            low = max(low, quartiles[0] - FARTHEST * between)
            high = min(high, quartiles[1] + FARTHEST * between)
            values = np.clip(values, low, high)
        pad = 0.05 * (high - low)
        counts, edges = np.histogram(values, np.linspace(low - pad, high + pad, BINS + 1))
        normal = between / 1.349
        spread = min(values.std(), normal) if normal > 0 else values.std()
        width = BANDWIDTH * 0.9 * spread * max(independent, 2.0) ** -0.2
        bins = max(width / (edges[1] - edges[0]), 0.5)
        smooth = gaussian_filter1d(counts / counts.sum(), bins)
        centers = (edges[:-1] + edges[1:]) / 2
        return cls(centers, counts.astype(np.float64), smooth, bins * (edges[1] - edges[0]))

    def chance_below(self, cut: float, width: float) -> NDArray[np.float64]:
        """Return for each bin the smoothed share of pairs below a cut, never rising.

        Parameters
        ----------
        cut
            Where the expert's pairs end.
        width
            Deviation of the smoothing.
        """
        # wider than all bins is as wide as all bins
        bins = min(max(width / (self.centers[1] - self.centers[0]), 0.5), BINS)
        below = gaussian_filter1d(self.counts * (self.centers <= cut), bins)
        every = gaussian_filter1d(self.counts, bins)
        # without pairs nearby, the nearest side decides
        side = (self.centers <= cut).astype(np.float64)
        chance = np.divide(below, every, out=side, where=every > 1e-9 * self.counts.sum())
        return np.minimum.accumulate(np.clip(chance, 0, 1))


@dataclass(frozen=True)
class Cut:
    """Where the expert's pairs may end.

    Parameters
    ----------
    at
        The value.
    share
        Share of the unlabeled pairs up to it.
    evidence
        Logarithm of how much speaks for it, up to a constant.
    chance
        The same, by which it may well be right: labels in plenty are not denied by a prior.
    low, high
        Bounds of the share, if this is the cut.
    by_labels
        Whether the labeled pairs alone speak for it.
    """

    at: float
    share: float
    evidence: float
    chance: float
    low: float
    high: float
    by_labels: bool


def find_cuts(
    values: NDArray[np.float64],
    density: Density,
    *,
    held_out: NDArray[np.float64] | None,
    stretch: int,
) -> list[Cut]:
    """Return where the expert's pairs may end, best first.

    Parameters
    ----------
    values
        Pooled uncertainty of the unlabeled pairs, (n,), sorted.
    density
        Their density.
    held_out
        Pooled uncertainty of labeled pairs held out, (m,); None for none.
    stretch
        About how many neighboring pairs one value rests on.

    Returns
    -------
    list of Cut
        Without a valley and without held-out pairs it is empty.
    """
    independent = len(values) / stretch
    labels = least = 0.0
    share = None
    cuts = []
    if held_out is not None and len(held_out):
        labels = max(len(held_out) / stretch, 0.3)
        share, most = _read_share(values, held_out, labels)
        least = _bound_below(values, held_out, labels)
        prior = _weigh_share(share)
        doubt = min(1.2 / labels, 2.0)
        spread = min(1.2 / np.sqrt(labels), 1.5)
        cuts.append(
            Cut(
                at=float(np.quantile(values, share)),
                share=share,
                evidence=prior - doubt,
                chance=prior * min(1.0, PLENTY / labels) - doubt,
                low=min(share * np.exp(-1.64 * spread), least),
                high=min(1.0, most * np.exp(1.64 * spread)),
                by_labels=True,
            )
        )
    for at, depth in _find_valleys(density, independent):
        below = _share_below(values, at)
        if below < least / FAR_TOO_FEW:
            continue
        evidence = _weigh_share(below) - np.log(max(depth, DEEPEST))
        if share is not None:
            evidence -= _disagreement(below, share, labels)
        cuts.append(
            Cut(
                at=at,
                share=below,
                evidence=float(evidence),
                chance=float(evidence),
                low=_share_below(values, at - density.width),
                high=_share_below(values, at + density.width),
                by_labels=False,
            )
        )
    return sorted(cuts, key=lambda cut: -cut.evidence)


def bound_share(cuts: list[Cut]) -> tuple[float, float]:
    """Return an interval of the expert share: that of every cut which may well be right.

    Parameters
    ----------
    cuts
        From `find_cuts`, at least one.
    """
    likely = [cut for cut in cuts if cut.chance >= cuts[0].evidence - 2]
    return min(cut.low for cut in likely), max(cut.high for cut in likely)


def _find_valleys(density: Density, independent: float) -> list[tuple[float, float]]:
    """Return where the density has its valleys, and their depth: 0 is empty, 1 is none."""
    smooth = density.smooth
    mass = np.cumsum(smooth)
    left = np.maximum.accumulate(smooth)
    right = np.maximum.accumulate(smooth[::-1])[::-1]
    found = []
    for place in range(1, len(smooth) - 1):
        is_least = smooth[place - 1] >= smooth[place] < smooth[place + 1]
        two_values = min(mass[place], 1 - mass[place]) * independent >= 2
        depth = smooth[place] / max(min(left[place], right[place]), 1e-300)
        if is_least and two_values and depth <= SHALLOWEST:
            found.append((float(density.centers[place]), float(depth)))
    return found


def _share_below(values: NDArray[np.float64], at: float) -> float:
    return float(np.searchsorted(values, at, side="right") / len(values))


def _read_share(
    values: NDArray[np.float64], held_out: NDArray[np.float64], labels: float
) -> tuple[float, float]:
    """Return the share that the held-out labeled pairs speak for, and the most that it may be.

    Labels of several drives crowd in the middle of the experts, so that high levels say most. Where
    there are few, half of them teach too little to judge the other half by: some look stranger than
    experts do, the high levels see too many others, and the least ratio says most.
    """
    ratios = np.log(_ratios(values, held_out, np.array(LEVELS)))
    doubt = min(1.0, (ENOUGH / labels) ** 2)
    most = ratios[-HIGHEST:].mean()
    ratio = (1 - doubt) * most + doubt * ratios.min()
    return float(min(1.0, np.exp(ratio))), float(min(1.0, np.exp(most)))


def _ratios(
    values: NDArray[np.float64], held_out: NDArray[np.float64], levels: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the share below each quantile of the labeled pairs, by what it would be of experts."""
    below = np.searchsorted(values, np.quantile(held_out, levels), side="right") / len(values)
    return np.maximum(below, 0.5 / len(values)) / levels


def _bound_below(
    values: NDArray[np.float64], held_out: NDArray[np.float64], labels: float
) -> float:
    """Return the least share that the held-out labeled pairs speak for at any level.

    Whoever else lies below a level is counted as an expert there, so that every level sees too
    many; low levels see the fewest others, and the fewest labeled pairs.

    Source
    ------
    Garg et al., Mixture Proportion Estimation and PU Learning, 2021.
    """
    levels = np.array((LOWEST_LEVEL, *LEVELS))
    spread = np.minimum(1.2 / np.sqrt(labels * levels), 1.5)
    return float(np.min(_ratios(values, held_out, levels) * np.exp(-1.64 * spread)))


def _disagreement(share: float, by_labels: float, labels: float) -> float:
    """Return what the difference of log shares speaks against, with the tails of a Cauchy.

    Labels of one drive are more alike than experts are, so they rather see too few of them, and
    sometimes by far.
    """
    offset = np.log(share / by_labels)
    spread = 1.5 / labels**0.75 if offset > 0 else 1.2 / np.sqrt(labels)
    return float(np.log1p(offset**2 / (2 * max(spread, 0.1) ** 2)))


def _weigh_share(share: float) -> float:
    """Return the prior of a share: hardly a pile of experts with a few strays, nor all others."""
    return float(6 * np.log(max(1 - share**2, 1e-3)) + 0.3 * np.log(share + 0.005))

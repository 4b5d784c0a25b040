"""Ensemble: several estimators at once, since none is the best on all data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.errors import InvalidInputError
from ssil_data.estimators.base import Estimator, Fitted, Uncertainty, check_equal
from ssil_data.estimators.contrast import Contrast
from ssil_data.estimators.gpr import GPR
from ssil_data.estimators.mdn import MDN
from ssil_data.estimators.unlabeled import UnlabeledSample
from ssil_data.json_kinds import show_short
from ssil_data.ranks import KNOTS, find_knots, normal_scores


def _choose_members() -> tuple[Estimator, ...]:
    """Return the members that measured best together.

    The Gaussian process learns from fewer pairs than when it is alone: it is as good here, at a
    tenth of the time.
    """
    process = GPR(learn_on=300, inducing=512, surprisal=True)
    return (process, MDN(surprisal=True), Contrast())


@dataclass(frozen=True)
class Ensemble(Estimator):
    """Mean rank of several estimators: uncertain = most of them find the pair strange.

    Each member's uncertainty becomes the normal score of its rank among unlabeled pairs; the
    uncertainty is the mean score, from −4 to 4; larger = less like the labeled pairs.

    Parameters
    ----------
    members
        The estimators, of different kinds, at least two.

    Raises
    ------
    InvalidInputError
        For fewer than two members, two of one kind, or an ensemble among them.

    Examples
    --------
    >>> ensemble = sd.Ensemble((sd.VAE(steps=20), sd.MDN(steps=20, surprisal=True)))
    >>> unlabeled = sd.UnlabeledSample.of(dataset.pairs()[120:])
    >>> fitted = ensemble.fit(dataset.labeled(), seed=0, unlabeled=unlabeled)
    >>> sorted(fitted.uncertainty(dataset.pairs()).parts)
    ['mdn', 'vae']
    """

    kind: ClassVar[str] = "ensemble"
    members: tuple[Estimator, ...] = ()

    def __post_init__(self) -> None:
        """Validate the members; without any, those that measured best together are taken."""
        given = self.members
        if not isinstance(given, list | tuple) or not all(isinstance(m, Estimator) for m in given):
            raise InvalidInputError(
                "ensemble: members: expected estimators such as (sd.VAE(), sd.Contrast()), "
                f"found {show_short(given)}"
            )
        members = tuple(given) or _choose_members()
        object.__setattr__(self, "members", members)
        kinds = [member.kind for member in members]
        if len(kinds) < 2 or len(set(kinds)) != len(kinds) or self.kind in kinds:
            raise InvalidInputError(
                f"ensemble: expected two or more members of different kinds, found {kinds}"
            )

    @property
    def needs_unlabeled(self) -> bool:
        """Whether it is fitted on unlabeled pairs too: it is, to rank by."""
        return True

    def fit(
        self, labeled: Pairs, *, seed: int, unlabeled: UnlabeledSample | None = None
    ) -> FittedEnsemble:
        """Fit every member to the labeled pairs, and rank them by the unlabeled ones.

        Parameters
        ----------
        labeled
            Expert pairs, two at least.
        seed
            Of every member. Same seed, same machine, same result.
        unlabeled
            A sample of the unlabeled pairs.

        Returns
        -------
        FittedEnsemble
            The fitted estimators with the quantiles of their uncertainty.

        Raises
        ------
        InvalidInputError
            Without unlabeled pairs, for fewer than two labeled ones or a seed outside 0 to
            2^63 − 1.
        """
        if unlabeled is None:
            raise InvalidInputError(
                "ensemble: needs unlabeled pairs, and every pair is labeled; choose another "
                "estimator, such as windowvae"
            )
        fitted = tuple(
            member.fit(labeled, seed=seed, unlabeled=unlabeled) for member in self.members
        )
        knots = [find_knots(member.uncertainty(unlabeled.pairs).total) for member in fitted]
        return FittedEnsemble(
            settings=self,
            state_width=labeled.states.shape[1],
            action_width=labeled.actions.shape[1],
            members=fitted,
            knots=np.stack(knots),
        )


@dataclass(frozen=True, eq=False)
class FittedEnsemble(Fitted):
    """r = mean over members of the normal score of their uncertainty's rank.

    Parameters
    ----------
    settings
        What it was fitted with.
    members
        The fitted estimators.
    knots
        Quantiles of each member's uncertainty among unlabeled pairs, (members, `KNOTS`).
    """

    settings: Ensemble
    members: tuple[Fitted, ...]
    knots: NDArray[np.float32]

    def __post_init__(self) -> None:
        """Validate that the members are those of the settings."""
        kinds = [member.settings.kind for member in self.members]
        check_equal("members", kinds, [member.kind for member in self.settings.members])
        check_equal("knots", self.knots.shape, (len(kinds), KNOTS))
        check_equal("knots that fall", bool((np.diff(self.knots) < 0).any()), False)

    @property
    def margin(self) -> int:
        """As many rows as the member that looks farthest."""
        return max(member.margin for member in self.members)

    def _uncertainty(self, pairs: Pairs) -> Uncertainty:
        parts = {member.settings.kind: member.uncertainty(pairs).total for member in self.members}
        scores = [
            normal_scores(values, knots)
            for values, knots in zip(parts.values(), self.knots, strict=True)
        ]
        total = np.zeros(len(pairs), np.float32)
        for score in scores:
            total += score
        return Uncertainty(total / np.float32(len(scores)), parts)

    def shares(self, pairs: Pairs) -> NDArray[np.float32] | None:
        """Return each state dimension's share, the mean of the members that have shares.

        Parameters
        ----------
        pairs
            n pairs of the fitted widths.
        """
        known = [share for m in self.members if (share := m.shares(pairs)) is not None]
        return np.stack(known).mean(axis=0, dtype=np.float32) if known else None

"""Recipes: how a run is made, and the named ones, `default` and `paper`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ssil_data import scales
from ssil_data.errors import InvalidInputError
from ssil_data.estimators import ESTIMATORS, MDN, Estimator, from_json, to_json
from ssil_data.scales import MinMax, Quantile, Scale
from ssil_data.store.run_record import Run

PRESETS = ("default", "paper")
"""The names of the presets."""


@dataclass(frozen=True)
class Recipe:
    """How a run is made: from pairs to uncertainty, and from uncertainty to leverage.

    Parameters
    ----------
    estimator
        What gives every pair an uncertainty; larger = less like the labeled pairs.
    scale
        What turns uncertainty into leverage in [0, 1]; 1 = expert-like.
    labeled_is_one
        Whether labeled pairs get leverage 1 whatever their uncertainty, as the paper does.

    Examples
    --------
    >>> sd.Recipe(sd.VAE(), sd.MinMax(), labeled_is_one=True).preset
    'paper'
    >>> run = sd.score(dataset, sd.Recipe(sd.VAE(steps=20), sd.MinMax()), seed=0)
    >>> run.scale
    {'kind': 'minmax'}
    """

    estimator: Estimator
    scale: Scale = field(default_factory=Quantile)
    labeled_is_one: bool = False

    @classmethod
    def of(cls, recipe: Recipe | Estimator) -> Recipe:
        """Return a recipe as it is, or that of an estimator with the quantile scale.

        Parameters
        ----------
        recipe
            Either.
        """
        if not isinstance(recipe, Recipe | Estimator):
            raise InvalidInputError(
                f"recipe: expected an estimator such as sd.WindowVAE() or a recipe such as "
                f"sd.preset('default', 'windowvae'), found {recipe!r}"
            )
        return recipe if isinstance(recipe, Recipe) else cls(recipe)

    @classmethod
    def of_run(cls, run: Run) -> Recipe:
        """Return the recipe that a run was made by.

        Parameters
        ----------
        run
            The run's record.
        """
        return cls(
            estimator=from_json(run.estimator),
            scale=scales.settings_from_json(run.scale),
            labeled_is_one=run.labeled_is_one,
        )

    @classmethod
    def from_json(cls, json: Mapping[str, Any]) -> Recipe:
        """Read a recipe from `to_json`'s object; other keys are ignored.

        Parameters
        ----------
        json
            The object.

        Raises
        ------
        InvalidInputError
            For a key that is missing, an unknown kind, or a value that does not fit.
        """
        for key in ("estimator", "scale", "labeled_is_one"):
            if key not in json:
                raise InvalidInputError(f"recipe: the key {key!r} is missing")
        if not isinstance(json["labeled_is_one"], bool):
            raise InvalidInputError(
                f"labeled_is_one: expected true or false, found {json['labeled_is_one']!r}"
            )
        return cls(
            estimator=from_json(json["estimator"]),
            scale=scales.settings_from_json(json["scale"]),
            labeled_is_one=json["labeled_is_one"],
        )

    def to_json(self) -> dict[str, Any]:
        """Return the recipe as a JSON object, as a run's record and a scoring job have it."""
        return {
            "estimator": to_json(self.estimator),
            "scale": scales.to_json(self.scale),
            "labeled_is_one": self.labeled_is_one,
        }

    @property
    def preset(self) -> str | None:
        """The name of the preset whose choices these are, however it was made; None for any other.

        Derived, so that neither an option nor `dataclasses.replace` can make it untrue.
        """
        kind = self.estimator.kind
        return next((name for name in PRESETS if preset(name, kind) == self), None)

    def with_options(self, *, scale: str | None, surprisal: bool | None) -> Recipe:
        """Return the recipe with some choices replaced.

        Parameters
        ----------
        scale
            Kind of another scale, with its default settings; None keeps the recipe's.
        surprisal
            Whether mdn or gpr judge the action that was taken; None keeps the recipe's choice.

        Raises
        ------
        InvalidInputError
            For surprisal of an estimator that has none.
        """
        estimator = self.estimator
        if surprisal is not None:
            if not hasattr(estimator, "surprisal"):
                raise InvalidInputError(
                    f"surprisal: expected the estimator mdn or gpr, found {estimator.kind}"
                )
            estimator = replace(estimator, surprisal=surprisal)
        chosen = self.scale if scale is None else scales.SCALES[scale]()
        return replace(self, estimator=estimator, scale=chosen)


def preset(name: str, kind: str) -> Recipe:
    """Return a named recipe for a kind of estimator.

    Parameters
    ----------
    name
        `paper`: min–max scale (Algorithm 1), labeled pairs get leverage 1, no surprisal.
        `default`: the best one measured (the README has the figures). An MDN's variances are no
        guide to quality on any data tried here, so it judges by surprisal; a GPR orders the tiers
        by its deviation and not by surprisal, though both separate experts from others.
    kind
        `vae`, `windowvae`, `mdn` or `gpr`.

    Raises
    ------
    InvalidInputError
        For another name or kind.

    Examples
    --------
    >>> sd.preset("paper", "vae").scale
    MinMax()
    >>> sd.score(dataset, sd.preset("paper", "vae"), seed=0).preset
    'paper'
    """
    if kind not in ESTIMATORS:
        raise InvalidInputError(f"estimator: expected one of {sorted(ESTIMATORS)}, found {kind!r}")
    if name not in PRESETS:
        raise InvalidInputError(f"preset: expected one of {sorted(PRESETS)}, found {name!r}")
    plain = ESTIMATORS[kind]()
    if name == "paper":
        return Recipe(plain, MinMax(), labeled_is_one=True)
    return Recipe(MDN(surprisal=True) if kind == MDN.kind else plain, Quantile())

"""Recipes: how a run is made, and the named ones, `default` and `paper`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ssil_data import pooling as poolings
from ssil_data import scales
from ssil_data.errors import InvalidInputError
from ssil_data.estimators import Estimator, from_json, to_json
from ssil_data.json_kinds import show_short
from ssil_data.pooling import NoPooling, Pooling
from ssil_data.scales import Posterior, Quantile, Scale
from ssil_data.scoring.presets import PAPER_KINDS, PRESETS, choose_parts
from ssil_data.scoring.recipe_checks import check_floor, check_part, check_switch, make_default
from ssil_data.store.run_record import Run


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
    pooling
        How uncertainty is pooled over time before it is scaled.
    scale_floor
        Least scale of a dimension that an estimator standardizes by the labeled pairs, as a share
        of its deviation among the unlabeled ones; 0 for none, as in the paper.
    cross_fit
        Whether labeled pairs are judged by estimators that were not fitted on them, to calibrate
        a posterior scale and to tell how good the run is. Fits three times instead of once.
    self_training
        Whether the estimator is fitted again with the purest unlabeled pairs as labeled ones, if
        they are pure enough.

    Raises
    ------
    InvalidInputError
        For a part that is of another type, a scale floor that is negative or not finite, or
        self-training without the posterior scale.

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
    pooling: Pooling = field(default_factory=NoPooling)
    scale_floor: float = 0.0
    cross_fit: bool = False
    self_training: bool = False

    def __post_init__(self) -> None:
        """Validate the type of every part, and the scale floor."""
        check_part("estimator", self.estimator, Estimator, "sd.WindowVAE()")
        check_part("scale", self.scale, Scale, "sd.Posterior()")
        check_part("pooling", self.pooling, Pooling, "sd.Window()")
        for name in ("labeled_is_one", "cross_fit", "self_training"):
            check_switch(name, getattr(self, name))
        check_floor("scale_floor", self.scale_floor)
        object.__setattr__(self, "scale_floor", float(self.scale_floor))
        if self.self_training and not isinstance(self.scale, Posterior):
            raise InvalidInputError(
                "self_training: needs leverage that is a chance, so the posterior scale; the scale "
                f"is {self.scale.kind}"
            )

    @property
    def needs_sample(self) -> bool:
        """Whether a sample of the unlabeled pairs is read before the fit."""
        return bool(
            self.estimator.needs_unlabeled
            or self.scale_floor
            or self.cross_fit
            or self.self_training
        )

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
                f"sd.preset('default', 'windowvae'), found {show_short(recipe)}"
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
        return cls.from_json(run.to_json())

    @classmethod
    def from_json(cls, json: Mapping[str, Any]) -> Recipe:
        """Read a recipe from `to_json`'s object; other keys are ignored.

        What came with later versions may be missing: pooling, scale floor, cross-fit and
        self-training are then off, as they were.

        Parameters
        ----------
        json
            The object.

        Raises
        ------
        InvalidInputError
            For a key that is missing, an unknown kind, or a value that does not fit.
        """
        if not isinstance(json, Mapping):
            raise InvalidInputError(f"recipe: expected a JSON object, found {show_short(json)}")
        for key in ("estimator", "scale", "labeled_is_one"):
            if key not in json:
                raise InvalidInputError(f"recipe: the key {key!r} is missing")
        switches = {
            name: json.get(name, False) for name in ("labeled_is_one", "cross_fit", "self_training")
        }
        return cls(
            estimator=from_json(json["estimator"]),
            scale=scales.settings_from_json(json["scale"]),
            pooling=poolings.settings_from_json(json.get("pooling", {"kind": NoPooling.kind})),
            scale_floor=json.get("scale_floor", 0.0),
            **switches,
        )

    def to_json(self) -> dict[str, Any]:
        """Return the recipe as a JSON object, as a run's record and a scoring job have it."""
        return {
            "estimator": to_json(self.estimator),
            "scale": scales.to_json(self.scale),
            "labeled_is_one": self.labeled_is_one,
            "pooling": poolings.to_json(self.pooling),
            "scale_floor": self.scale_floor,
            "cross_fit": self.cross_fit,
            "self_training": self.self_training,
        }

    @property
    def preset(self) -> str | None:
        """The name of the preset whose choices these are, however it was made; None for any other.

        Derived, so that neither an option nor `dataclasses.replace` can make it untrue.
        """
        kind = self.estimator.kind
        names = PRESETS if kind in PAPER_KINDS else ("default",)
        return next((name for name in names if preset(name, kind) == self), None)

    def with_options(
        self,
        *,
        scale: str | None = None,
        surprisal: bool | None = None,
        pooling: str | None = None,
        expert_share: float | None = None,
    ) -> Recipe:
        """Return the recipe with some choices replaced.

        Parameters
        ----------
        scale
            Kind of another scale, with its default settings; None keeps the recipe's.
        surprisal
            Whether mdn or gpr judge the action that was taken; None keeps the recipe's choice.
        pooling
            Kind of another pooling, with its default settings; None keeps the recipe's.
        expert_share
            The share of the expert's pairs among the unlabeled ones, if it is known; None to
            estimate it.

        Raises
        ------
        InvalidInputError
            For an unknown kind, surprisal of an estimator that has none, or a share with another
            scale than the posterior.
        """
        estimator = self.estimator
        if surprisal is not None:
            if not hasattr(estimator, "surprisal"):
                raise InvalidInputError(
                    f"surprisal: expected the estimator mdn or gpr, found {estimator.kind}"
                )
            estimator = replace(estimator, surprisal=surprisal)
        chosen = self.scale if scale is None else make_default("scale", scale, scales.SCALES)
        if expert_share is not None:
            if not isinstance(chosen, Posterior):
                raise InvalidInputError(
                    f"expert_share: only the posterior scale takes one, the scale is {chosen.kind}"
                )
            chosen = replace(chosen, expert_share=expert_share)
        pooled = self.pooling
        if pooling is not None:
            pooled = make_default("pooling", pooling, poolings.POOLINGS)
        return replace(self, estimator=estimator, scale=chosen, pooling=pooled)


def preset(name: str, kind: str | None = None) -> Recipe:
    """Return a named recipe for a kind of estimator.

    Parameters
    ----------
    name
        `paper`: min–max scale (Algorithm 1), labeled pairs get leverage 1, no surprisal, nothing
        pooled.
        `default`: what measured best: a window over time, the posterior scale, a floor under the
        scale of dimensions; mdn and gpr judge the action that was taken.
    kind
        `ensemble`, `vae`, `windowvae`, `mdn`, `gpr` or `contrast`; without one, `default` takes the
        ensemble. `paper` needs one of the paper's: `vae`, `windowvae`, `mdn` or `gpr`.

    Raises
    ------
    InvalidInputError
        For another name or kind, or the paper without one.

    Examples
    --------
    >>> sd.preset("paper", "vae").scale
    MinMax()
    >>> sd.score(dataset, sd.preset("paper", "vae"), seed=0).preset
    'paper'
    """
    return Recipe(**choose_parts(name, kind))

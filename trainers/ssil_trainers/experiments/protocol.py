"""The paper's tables as data: which methods on which labels, where they train and are tested."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ssil_trainers.algorithms.config import TrainSettings

ESTIMATORS = ("gpr", "mdn", "vae", "windowvae")
SHARED_RUN = "windowvae"
"""Whose leverage the controls shuffle, and imitation is weighted by."""


@dataclass(frozen=True)
class Row:
    """One method of a table. One that is `labeled` is trained for every number of labels."""

    method: str
    title: str
    estimator: str | None = None
    labeled: bool = True

    @property
    def key(self) -> str:
        """The name in files and claims."""
        return f"{self.method}-{self.estimator}" if self.estimator else self.method


@dataclass(frozen=True)
class Table:
    """One table of training runs.

    labels: None is all that there are. tests: tasks of the real environment that a policy's score
    is the mean over; `train_on` is where it learns, on the twin. full_score: the return that counts
    as 1, None for the expert's mean return. budget: environment steps of one run.
    """

    name: str
    title: str
    dataset: str
    train_on: str
    tests: tuple[str, ...]
    labels: tuple[int | None, ...]
    rows: tuple[Row, ...]
    budget: int
    evaluate_every: int
    pretrained: bool = False
    full_score: float | None = None
    episodes: int = 10

    def settings(self, given: TrainSettings, *, seed: int, budget: int | None) -> TrainSettings:
        """Return the settings of one run: `given`, the same for every method, and the table's."""
        return replace(
            given,
            seed=seed,
            steps=self.budget if budget is None else budget,
            pretrained=self.pretrained,
            evaluate_every=self.evaluate_every,
        )


def _ssil(*estimators: str) -> tuple[Row, ...]:
    titles = {"gpr": "GPR", "mdn": "MDN", "vae": "VAE", "windowvae": "windowVAE"}
    return tuple(Row("ssil", f"SSIL ({titles[kind]})", kind) for kind in estimators)


_CONTROLS = (
    Row("shuffled", "SSIL, leverage shuffled", SHARED_RUN),
    Row("constant", "constant reward", labeled=False),
    Row("clone", "behaviour cloning"),
)

RACETRACK = Table(
    name="racetrack",
    title="Table I: racetrack, fewer and more labels",
    dataset="racetrack",
    train_on="racetrack",
    tests=("racetrack",),
    labels=(100, 300, 600, 1_200),
    rows=(
        Row("gail-mixed", "GAIL, mixed", labeled=False),
        Row("gail", "GAIL, labeled"),
        Row("mixgail", "MixGAIL"),
        *_ssil(*ESTIMATORS),
        *_CONTROLS,
    ),
    budget=122_880,
    evaluate_every=5,
)

RC_LIDAR = Table(
    name="rc-lidar",
    title="Table III: RC car with a LiDAR",
    dataset="rc-lidar",
    train_on="rc-lidar",
    tests=tuple(f"rc-lidar?track={track}" for track in ("attic", "cellar", "garage", "loft")),
    labels=(None,),
    rows=(
        Row("gail", "GAIL"),
        Row("mixgail", "MixGAIL"),
        *_ssil("mdn", "vae", "windowvae"),
        *_CONTROLS,
    ),
    budget=40_960,
    evaluate_every=1,
    pretrained=True,
    full_score=400.0,
)

RC_LIDAR_TIGHT = replace(
    RC_LIDAR, name="rc-lidar-tight", title=f"{RC_LIDAR.title}, a fifth of the steps", budget=8_192
)
"""Survival is the score and any reward pays for it, a constant one too: given time, all survive."""

FEW_LABELS = Table(
    name="few-labels",
    title="Table IV, not in the paper: few labels, little driving",
    dataset="racetrack",
    train_on="racetrack",
    tests=("racetrack",),
    labels=(50, 100),
    rows=(
        Row("gail-mixed", "GAIL, mixed"),
        Row("gail", "GAIL, labeled"),
        Row("mixgail", "MixGAIL"),
        Row("ssil", "SSIL", SHARED_RUN),
        Row("gail-leverage", "GAIL, all by leverage", SHARED_RUN),
        Row("ssil-leverage", "SSIL, all by leverage", SHARED_RUN),
        Row("clone-mixed", "cloning of all"),
        Row("clone", "behaviour cloning"),
        Row("clone-leverage", "cloning of all by leverage", SHARED_RUN),
    ),
    budget=16_384,
    evaluate_every=1,
    pretrained=True,
)
"""Eight iterations after cloning: where unlabeled pairs, imitated by their leverage, pay.

The rows that imitate all pairs with equal weights are the controls of those by leverage.
"""

TRAINING_TABLES = (RACETRACK, RC_LIDAR, RC_LIDAR_TIGHT, FEW_LABELS)
LEVERAGE = "leverage"
LEVERAGE_PRESETS = ("paper", "default")

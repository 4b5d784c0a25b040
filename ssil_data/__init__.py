"""Which demonstrations can be trusted: leverage, LCoR, and the store that holds them.

    import ssil_data as sd

    racetrack = sd.Store("datasets")["racetrack"]
    run = sd.score(racetrack, sd.WindowVAE(), seed=0)
    field = racetrack.field(run.name)
    field.lcor(states).values

Names are imported when they are first used, so that `import ssil_data` costs nothing.
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

__version__: str
"""Version of the installed package; pyproject.toml is its one place."""

if TYPE_CHECKING:
    from ssil_data.client import ServiceError, connect
    from ssil_data.demonstrations import Episode, Pairs
    from ssil_data.errors import (
        ConflictError,
        DamagedError,
        InvalidInputError,
        NotFoundError,
        SsilDataError,
    )
    from ssil_data.estimators import (
        GPR,
        MDN,
        VAE,
        Contrast,
        Ensemble,
        UnlabeledSample,
        WindowVAE,
    )
    from ssil_data.field import Accuracy, LCoR, LeverageField
    from ssil_data.pooling import HiddenMarkov, NoPooling, Window
    from ssil_data.quality import Quality, measure_quality
    from ssil_data.report import write_report
    from ssil_data.scales import Conformal, MinMax, Posterior, Quantile
    from ssil_data.scoring import LeverageModel, Recipe, preset, rescore, score
    from ssil_data.store import Store
    from ssil_data.store.dataset import Dataset
    from ssil_data.store.run_record import Run

_HOME = {
    "Accuracy": "field",
    "ConflictError": "errors",
    "Conformal": "scales",
    "connect": "client",
    "Contrast": "estimators",
    "DamagedError": "errors",
    "Dataset": "store",
    "Ensemble": "estimators",
    "Episode": "demonstrations",
    "GPR": "estimators",
    "HiddenMarkov": "pooling",
    "InvalidInputError": "errors",
    "LCoR": "field",
    "LeverageField": "field",
    "LeverageModel": "scoring",
    "MDN": "estimators",
    "measure_quality": "quality",
    "MinMax": "scales",
    "NoPooling": "pooling",
    "NotFoundError": "errors",
    "Pairs": "demonstrations",
    "Posterior": "scales",
    "preset": "scoring",
    "Quality": "quality",
    "Quantile": "scales",
    "Recipe": "scoring",
    "rescore": "scoring",
    "Run": "store",
    "score": "scoring",
    "ServiceError": "client",
    "SsilDataError": "errors",
    "Store": "store",
    "UnlabeledSample": "estimators",
    "VAE": "estimators",
    "Window": "pooling",
    "WindowVAE": "estimators",
    "write_report": "report",
}

__all__ = [
    "GPR",
    "MDN",
    "VAE",
    "Accuracy",
    "ConflictError",
    "Conformal",
    "Contrast",
    "DamagedError",
    "Dataset",
    "Ensemble",
    "Episode",
    "HiddenMarkov",
    "InvalidInputError",
    "LCoR",
    "LeverageField",
    "LeverageModel",
    "MinMax",
    "NoPooling",
    "NotFoundError",
    "Pairs",
    "Posterior",
    "Quality",
    "Quantile",
    "Recipe",
    "Run",
    "ServiceError",
    "SsilDataError",
    "Store",
    "UnlabeledSample",
    "Window",
    "WindowVAE",
    "connect",
    "measure_quality",
    "preset",
    "rescore",
    "score",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return version("ssil-data")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__

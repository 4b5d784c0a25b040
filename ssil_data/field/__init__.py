"""The leverage field: LCoR and CoR of states, computed over all demonstrations."""

from ssil_data.field.answers import Contributors, LCoR
from ssil_data.field.leverage_field import LeverageField
from ssil_data.field.query import Accuracy, LCoROptions, LCoRQuery
from ssil_data.field.sharpness import auto_alpha

__all__ = [
    "Accuracy",
    "Contributors",
    "LCoR",
    "LCoROptions",
    "LCoRQuery",
    "LeverageField",
    "auto_alpha",
]

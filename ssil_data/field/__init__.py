"""The leverage field: LCoR and CoR of states, computed over all demonstrations."""

from ssil_data.field.answers import Accuracy, Contributors, LCoR
from ssil_data.field.leverage_field import LeverageField, auto_alpha

__all__ = ["Accuracy", "Contributors", "LCoR", "LeverageField", "auto_alpha"]

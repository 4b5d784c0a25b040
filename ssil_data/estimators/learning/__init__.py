"""Training code of the estimators: the only modules here that import torch.

It takes arrays and numbers and returns arrays; `fit` imports it when it is called, so that neither
settings nor scoring with a fitted estimator load torch.
"""

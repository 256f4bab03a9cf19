"""Fit parameters to measurements, whatever the model.

An `experiment` has parameters and residuals in blocks. `fit` searches, fits, and estimates the uncertainty of the
result with `uncertainty`, `intervals` and `between_logs`. `model_selection` selects among nested models, `comparison`
compares the errors of two models, and `least_squares` fits linear models. `run` is the context of a long computation,
and `sweep` stores finished runs in a folder. Nothing here knows a robot's equations.
"""

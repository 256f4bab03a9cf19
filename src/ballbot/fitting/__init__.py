"""Estimation as such: what any fit of parameters to measurements needs, whatever the model.

An `experiment` is parameters and residuals in blocks; `fit` searches, fits, and says how sure the result is. It uses
`uncertainty`, `intervals` and `between_logs`; `model_selection` selects among nested models, and `comparison` compares
the errors of two models. `least_squares` fits models that are linear. `run` is the context of a long computation,
`sweep` keeps many runs as they are finished, and `cluster` is the workers of a Dask scheduler. Nothing here knows a
robot's equations.
"""

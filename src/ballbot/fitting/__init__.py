"""Estimation as such: what any fit of parameters to measurements needs, whatever the model.

`run` is the context of a long computation, `sweep` keeps many runs as they are finished, and `cluster` is the
workers of a Dask scheduler. A `parameter` is scaled for a `search` of the cost's minimum or for `least_squares`.
`uncertainty` and `intervals` give its standard error and interval, `model_selection` selects among nested models, and
`comparison` compares the errors of two models. Nothing here knows a robot's equations.
"""

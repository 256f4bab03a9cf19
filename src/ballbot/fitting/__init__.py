"""Estimation as such: what any fit of parameters to measurements needs, whatever the model.

`run` is the context of a long computation, `checkpoint` its journal and `cluster` the workers of a Dask scheduler. A
`parameter` is scaled for a `search` of the cost's minimum; `uncertainty` and `intervals` say how well it is determined,
and `model_selection` whether the measurements support it at all. Nothing here knows a robot's equations.
"""

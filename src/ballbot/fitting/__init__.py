"""Estimation as such: what any fit of parameters to measurements needs, whatever the model.

`run` has what every long computation shares, `checkpoint` its journal and `cluster` the workers of a Dask scheduler;
`search` finds a basin, `uncertainty` says how sure an estimate is.
"""

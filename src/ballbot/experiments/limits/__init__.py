"""How far a robot with its controller can go: leans, blows, and references to follow.

`limits.find_limits` maps what is survived on the model, `twin_edges.twin_edges` tries it on the twin, and
`reference_margins.check_reference` says whether a reference can be followed before it is tried.
"""

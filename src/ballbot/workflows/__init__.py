"""What a user wants done, from robot and logs to a result: each workflow is a function that a command calls.

study.py                  the main job: identify, validate, choose a controller on perturbed plants
controller_*.py           the choice, the prediction for the next run, and the verdict on it
alternation.py            two controllers in turn on one robot, A B A B, the drift removed
grid.py                   one grid of runs: controllers x courses x plants x seeds, one table out
league.py                 controllers against each other on the same courses with the same seeds, and the standings
excite.py                 an informative excitation for identification
limits.py                 the largest tilts and impulses that a robot recovers from; what a reference demands
record.py                 a run of the twin, and the files that say how it was made
"""

"""Golden results: what every command writes today, so that a change of structure is seen to change no number.

    python -m tests.golden                      # compare all cases; exit code 1 if anything differs
    python -m tests.golden --check identify     # compare these
    python -m tests.golden --update identify    # write these anew

`cases` lists the command lines and how their inputs are made, `freeze` says what is kept of a result, `compare` says
where two differ. `results/NAME.json` is the golden of a case, `machine.json` the machine that made the goldens.
`files/` has files as version 0.1.0 writes them: later versions read them.

Whatever changes a number on purpose updates the golden in the same commit, with the old value, the new one, the cause
and the oracle that decides between them.

The pages evidence.md and reproduce.md in docs/generated are not copied here. They are committed pages that campaigns
write, and their numbers stand as they are; no test reads evidence.md. Its campaigns are sampled with bounds of their
own in campaigns/tests. reproduce.md, which `python -m campaigns.reproduce` writes, is compared with a fresh run by
test_reproduce, as far as it needs no recording.
"""

import os

# one thread of BLAS, as in all tests: a sum over two threads has other last digits
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported

"""Identify and validate a robot from logs in Python: the first stages of `ballbot study`.

    python examples/03_study.py demo/square/log.csv demo/figure_eight/log.csv

`make demo` records these logs on the twin. The script takes some ten seconds.
"""

import sys

import ballbot
from ballbot.validation import findings

robot = ballbot.Robot.load("alten")
logs = [ballbot.Log.read(path) for path in sys.argv[1:]]
if not logs:
    sys.exit("Name one or more logs, such as those that `make demo` records.")

found = ballbot.identify(robot, logs)
for name, value in found.parameters.items():
    print(f"{name:5} = {value}  +- {found.standard_errors[name]}")

validation = ballbot.validate(found.robot, logs[0])
for finding in findings(validation):
    print(finding.text)

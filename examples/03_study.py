"""From logs to a controller, in Python: what `ballbot study` does, a stage at a time.

    python examples/03_study.py demo/square/log.csv demo/figure_eight/log.csv

`make demo` records these logs on the twin.
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
    print(finding)

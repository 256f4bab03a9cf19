"""How a foreign log becomes one of Ballbot's: a mapping inferred, tested against the robot, with its evidence.

roles          the role and unit of each column, by name or by values
placement      azimuths of the wheels and the command of each, by two tests of accelerations
proposal       the mapping proposed (`propose`)
report         the findings, and the mapping file with the reasons as comments
"""

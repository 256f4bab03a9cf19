"""How a foreign log becomes one of Ballbot's: a mapping inferred, tested against the robot, with its evidence.

roles          which column is what, by name or by values, and in which unit
placement      where the wheels sit and which command drives which: two tests by accelerations
proposal       the mapping proposed (`propose`)
findings       what is sure, what is not, and what log would show it
mapping_text   the proposal as a mapping file with its reasons
"""

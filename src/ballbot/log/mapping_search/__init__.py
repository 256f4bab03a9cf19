"""What a foreign log's names, units and motion show of its columns, wheels, IMU and commands.

names       what the names of columns say, and which column is which quantity
motion      what the sensors show, with the units that fit them
commands    which command drives which wheel, with which sign, in which scale, how late

The checks of a log use it; `ballbot.log.proposal` puts all of it together for a file.
"""

"""How a foreign log becomes one of Ballbot's: what the user states, what the motion shows, what is left to ask.

names       what the names of columns say, and which column is which quantity
units       units by headings, else by what physics supports
placement   how the lean responds to the wheels, in every order and sign, and how wheels and IMU then sit
motion      what the sensors show, with the units that fit them
commands    which command drives which wheel, with which sign, in which scale, how late
evidence    weights and errors
proposal    all of this for one file (`propose`), its mapping file and log (`evaluate`), several logs of one robot
"""

"""How a foreign log becomes one of Ballbot's: a mapping proposed, tested against the robot, with its evidence."""

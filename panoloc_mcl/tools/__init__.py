"""The tools around the robot: data sets, runs, evaluation, reports and the command line."""

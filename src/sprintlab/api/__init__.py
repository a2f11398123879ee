"""What a program does with sprintlab: train, race, evaluate, estimate limits; the command line prints it."""

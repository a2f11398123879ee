"""The second engine: the robot of evaluation in Drake, with dynamics, contact and solver of its own."""

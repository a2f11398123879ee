"""How well the motor law predicts motors that others measured: identify on one part, predict the other."""

"""From a data sheet or a test bench to a motor file."""

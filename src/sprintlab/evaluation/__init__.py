"""Measures a policy file: plant, trials, protocol, metrics, exploit audit."""

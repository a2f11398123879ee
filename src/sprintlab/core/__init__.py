"""Errors, field checks, atomic files and the look of figures: what every floor stands on."""

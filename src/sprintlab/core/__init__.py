"""Errors, field checks and atomic files: what every floor stands on."""

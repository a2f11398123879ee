"""The motor law and the command scheduler inside other people's frameworks: one package a guest."""

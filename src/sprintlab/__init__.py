"""How fast can a legged robot run before its motors, not its controller, stop it?"""

__version__ = "0.1.0"

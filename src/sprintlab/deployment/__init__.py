"""On the robot: messages, bus, real-time controller, safety."""

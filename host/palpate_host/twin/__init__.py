"""The twin: simulated parts that speak the real parts' protocols at their real borders."""

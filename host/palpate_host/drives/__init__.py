"""The joint drives as the host sees them: CiA 402 over CANopen."""

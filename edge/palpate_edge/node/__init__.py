"""The CANopen slave: a pure core, ``process(now_us, frames_in) -> Output``, one CiA 301 service a file."""

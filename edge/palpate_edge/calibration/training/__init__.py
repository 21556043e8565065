"""Fitting the correction model (extra ``train``): samples -> kernel ridge -> ONNX. No daemon imports it."""

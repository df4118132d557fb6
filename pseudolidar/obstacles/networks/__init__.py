"""Detectors in ONNX files: how they are fed, told apart and read."""

"""Networks in ONNX files: what they say of themselves, and running them."""

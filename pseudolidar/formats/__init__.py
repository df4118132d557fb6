"""Bytes to nouns and back; read_x beside write_x, one format a file.

- `points`: clouds; `pictures`: images, and maps stored as images; `rigs`: calibrations
- `mcap`: written, read, checked, recovered; `ros`: messages and bags; `recordings`: what the
  messages of either say; `video`
- KITTI's own here: `labels`, `oxts`, `timestamps`, `trajectory`
- for all: `atomic` (the one write path), `limits` (caps on input), `text` (the one number grammar)
"""

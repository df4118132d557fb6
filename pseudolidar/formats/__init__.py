"""Bytes to nouns and back; read_x beside write_x, one format a file.

A format that needs several files has one that others import, and parts by the same first word:

- clouds: `pcd`, `ply`, `npz`, `velodyne_bin`; `columns` maps the noun's columns to named fields
- maps: `disparity_png`, `depth_png` (both on `png16`), `pfm`, `disparity_npy`
- pictures: `image`; headers and damage are found in `image_*`, `jpeg_*`, `tiff_header`
- KITTI: `kitti` (calibration), `labels`, `oxts`, `timestamps`, `trajectory`
- rigs: `rig_json` on `strict_json`; recordings: `mcap`, read back by `mcap_check`
- for all: `atomic` (the one write path), `limits` (caps on input), `text` (the one number grammar)
"""
